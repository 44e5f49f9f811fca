"""Leg models: the plain one of the paper, and corrections of it with more parameters (the paper's future work).

With v = P + R b - a and measured (P, R, L), every model is

    g(x, M) = sqrt(||v||^2 - h(x, M)) - (L + l + t(x, M))        in mm

where the plain model has h = t = 0. A model's extra parameters vanish when there is nothing to correct, so every model
contains the plain one: its smallest eps is never larger.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Annotated, NamedTuple, TypeVar

import numpy as np

from cpcal.checker.certificate import Given, polynomial
from cpcal.checker.leg import Measurement, leg_problem
from cpcal.common.codec import Informed, checked
from cpcal.common.errors import InputError, ModelError, PluginError, Problem, unusable
from cpcal.common.least_squares import least_squares
from cpcal.common.numbers import nearest
from cpcal.common.numbers import stated as as_stated
from cpcal.common.values import BACK, FORTH, ArrayLike, Floats, Names, Places, floats, norms
from cpcal.files import campaign_sha256
from cpcal.robot import Campaign, LegEquations, leg_vectors
from cpcal.robot.kinematics import rotation_numerators
from cpcal.solver.certificate.exact_network import NotStated, Statement, free, network_statement, stated_leg
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr, norm, sqr, sqrt
from cpcal.solver.network.expression import as_expr
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Rows
from cpcal.solver.network.tape import Tape

PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")


@dataclass(frozen=True)
class Parameter:
    """An extra parameter of a leg model; it is looked for within `half_width` (in `unit`) of 0."""

    name: Annotated[str, checked("the unknown of the certificates")]
    unit: Informed[str]
    half_width: Annotated[float, checked("the box of each certificate")]


class Drawn(NamedTuple):
    """One leg at N measurements as the drawing has it: plain numbers, in the campaign's frames.

    vector (N, 3) mm: P + R b - a at the stated poses with the nominal a and b. length (N,) mm: the stated readings.
    offset mm: the nominal l. up (3,): unit normal of the base joints' plane, towards the platform.
    """

    vector: Floats
    length: Floats
    offset: float
    up: Floats


@dataclass(frozen=True, eq=False)
class Measured:
    """What the N measurements of one leg are to a model, as expressions: values in the reading sets.

    `position` (N, 3): P, mm, base frame. `length` (N,): L, mm. `rotate(u)` (N, 3): R u for three numbers u.
    `vector` (N, 3): v = P + R b - a, mm, which holds unknowns. `drawing`: makes `drawn`, which few models ask for.
    """

    position: Expr
    length: Expr
    vector: Expr
    rotate: Callable[[ArrayLike], Expr]
    drawing: Callable[[], Drawn]

    @cached_property
    def drawn(self) -> Drawn:
        """Numbers of the drawing and the stated readings."""
        return self.drawing()


Parameters = Mapping[str, Expr]  # of the extra parameters, by name
Term = Callable[[Measured, Parameters], Expr]  # (N,), or a number for all


@dataclass(frozen=True)
class LegModel:
    """A model by its extra parameters and what they do. `term` is t in mm, `square` is h in mm^2; see the module.

    `summary` completes "the length of a leg is ...". Only sums and products of what is measured and of the unknowns can
    be bounded well; of degree one in the unknowns for `term`, two for `square`, if it is to have a certificate.
    """

    name: str
    summary: str
    extra: tuple[Parameter, ...] = ()
    term: Term | None = None
    square: Term | None = None

    @property
    def parameters(self) -> Names:
        """All names: the seven of the plain model first."""
        return (*PARAMETERS, *(p.name for p in self.extra))

    @property
    def half_widths(self) -> Floats:
        """Of the extra parameters, in their units."""
        return floats([p.half_width for p in self.extra])

    def equation(self, measured: Measured, offset: Expr, extra: Parameters) -> Expr:
        """g (N,) in mm; `offset` is l."""
        distance, length = norm(measured.vector), measured.length + offset
        if self.square is not None:
            distance = sqrt(sqr(measured.vector).sum(-1) - self._of("square", self.square, measured, extra))
        if self.term is not None:
            length = length + self._of("term", self.term, measured, extra)
        return distance - length

    def _of(self, what: str, function: Term, measured: Measured, extra: Parameters) -> Expr:
        """What the model's function gives, if it is an expression for each measurement. Raises ModelError."""
        found, shape = function(measured, extra), measured.length.shape
        if not isinstance(found, Expr) or found.shape not in ((), shape):
            raise ModelError(f"{what} of the model {self.name!r} must give an expression of shape {shape} or ()")
        return found

    def within(self, half_widths: Mapping[str, float]) -> LegModel:
        """The same model with other half-widths of some extra parameters. Raises InputError."""
        problems = list(half_width_problems(self, half_widths))
        if problems:
            raise InputError(problems)
        extra = (replace(p, half_width=float(half_widths.get(p.name, p.half_width))) for p in self.extra)
        return replace(self, extra=tuple(extra))


def half_width_problems(model: LegModel, half_widths: Mapping[str, float]) -> list[Problem]:
    """What is wrong with half-widths for a model."""
    names = [p.name for p in model.extra]
    known = f"its extra parameters are {', '.join(names)}" if names else "it has no extra parameters"
    out = [
        Problem("half_widths", f"model {model.name!r} has no extra parameter {name!r}", known)
        for name in half_widths
        if name not in names
    ]
    for name, value in half_widths.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and math.isfinite(value) and value >= 0.0):
            out.append(Problem("half_widths", f"{value!r} is no half-width of {name!r}", "give a number, 0 or more"))
    return out


# the models that come with cpcal ------------------------------------------------------------------------------


def _gain(measured: Measured, x: Parameters) -> Expr:
    return measured.length * x["s"]


def _lateral(measured: Measured, x: Parameters) -> Expr:
    return x["h"]


PLAIN = LegModel("plain", "L + l: the distance of the joint centres is what the sensor reads, and an offset")
GAIN = LegModel(
    "gain", "L (1 + s) + l: the sensor of the leg has a gain error s", (Parameter("s", "mm/mm", 0.05),), _gain
)
LATERAL = LegModel(
    "lateral",
    "L + l beside a lateral offset between the joint centres: ||v||^2 = (L + l)^2 + h (h < 0 corrects the other way)",
    (Parameter("h", "mm^2", 900.0),),
    square=_lateral,
)

BUILT_IN = (PLAIN, GAIN, LATERAL)


def built_in(model: LegModel) -> bool:
    """Whether it comes with cpcal, with any half-widths: the checker of certificates knows those by their names."""
    return any(
        (model.name, model.parameters, model.term, model.square) == (m.name, m.parameters, m.term, m.square)
        for m in BUILT_IN
    )


def model_name_problem(name: str) -> str:
    """Why a user-defined model cannot have this name, which stands for it in files and pages; empty where it can."""
    if not (name.isascii() and name.isidentifier()):
        return f"{name!a:.60} is no ASCII identifier, as names of models are"
    return f"{name!r} is the name of a model of cpcal" if name.lower() in (m.name for m in BUILT_IN) else ""


def model_problems(model: LegModel) -> list[Problem]:
    """What is wrong with a user-defined model: its name, its parameters' names or half-widths, or that it corrects
    nothing."""
    names, wrong = [p.name for p in model.extra], model_name_problem(model.name)
    problems = [Problem("model", wrong, "choose another name")] if wrong else []
    if not names or (model.term is None and model.square is None):
        problems.append(
            Problem(f"model {model.name!r}", "corrects nothing", "give extra parameters, and term or square")
        )
    taken = {"a", "b", "l", "eps"}
    for name in names:
        if not (name.isascii() and name.isidentifier()) or name in taken:
            what = f"{name!a} is no ASCII identifier, or taken"
            problems.append(Problem(f"model {model.name!r}", what, "choose another"))
        taken.add(name)
    return problems + half_width_problems(model, {p.name: p.half_width for p in model.extra})


# ------------------------------------------------------------------------------------------------------------------
# Leg models by name: those that come with cpcal, and those that other packages provide by entry point.


def leg_model(model: str | LegModel) -> LegModel:
    """The model of that name, or the model given.

    Raises InputError with everything that is wrong with the name or the model, PluginError when the package that
    provides it does not load.
    """
    ours = {m.name: m for m in BUILT_IN}
    if isinstance(model, str) and model in ours:
        return ours[model]
    if isinstance(model, str):
        from cpcal.solver import plugins  # here: models that come with cpcal need none

        name, group = model, plugins.LEG_GROUP
        known = plugins.found(group)
        if name not in known:
            remedy = (
                f"use one of {', '.join(dict.fromkeys([*ours, *known]))}, pass a LegModel, or install the package that "
                f"provides it (entry point {group})"
            )
            raise unusable("model", f"{name!r} is not known", remedy)
        model = plugins.load(name, group)
        if not isinstance(model, LegModel) or model.name != name:
            raise PluginError(f"leg model {name!r} ({known[name].value}) is no cpcal.LegModel of that name")
    problems = [] if built_in(model) else model_problems(model)
    if problems:
        raise InputError(problems)
    return model


# ------------------------------------------------------------------------------------------------------------------
# The leg model `sag`: a leg that its own weight bends, which brings its ends together.
#
#     t = -c ((L + l0) / s)^7 sin^2(tilt)
#
# is what is added to the length of a uniform slender beam on two hinges, with one parameter: c, by how much it would
# shorten lying flat with its mid-range length s. Length and tilt are taken from the stated reading and the drawing's
# joint centres, so that the correction is a number for each measurement times c: the reading's set and the drawing's
# errors change it by parts in a thousand. The base is taken to be level: vertical is the normal of its joints' plane.


def sag_shape(leg: Floats, length: Floats, middle: Floats | float, up: Floats) -> Floats:
    """How much a leg (..., 3), of that length (...), shortens by its weight, as a share of what it would lying flat
    with the length `middle`. The chord of a uniform beam on two hinges shortens with the seventh power of its length.
    """
    cosine = (leg @ up) / norms(leg)
    return np.asarray((length / middle) ** 7 * (1.0 - cosine**2))


def _sag(measured: Measured, x: Parameters) -> Expr:
    drawn = measured.drawn
    middle = drawn.offset + 0.5 * float(drawn.length.min() + drawn.length.max())
    return -1.0 * (x["c"] * as_expr(sag_shape(drawn.vector, drawn.length + drawn.offset, middle, drawn.up)))


SAG = LegModel(
    "sag",
    "L + l - c (length / mid-range length)^7 sin(tilt)^2: the leg's weight bends it, c is what it loses lying flat",
    (Parameter("c", "mm", 10.0),),
    _sag,
)


# ------------------------------------------------------------------------------------------------------------------
# One leg of a Gough platform as a constraint network (paper, eq. 15; DESIGN section 1).
#
# Unknowns x = (a, b, l) in mm: base joint centre `a` in the base frame, mobile joint centre `b` in the mobile
# frame, length offset `l`; the extra parameters of the leg model, if it has some; and the model error eps, in mm,
# itself
# an unknown of the network.


def leg_box(center: ArrayLike, delta: float, model: LegModel = PLAIN) -> Box:
    """X0: (a, b, l) within `delta` mm of the first seven of `center`, extra parameters within their half-widths of 0.

    Rounded outward.
    """
    x = floats(center)
    bounds = IntervalArray.around(x[:7], delta)
    reach = model.half_widths
    return Box(model.parameters, np.append(bounds.lo, -reach), np.append(bounds.hi, reach))


def leg_network(
    campaign: Campaign,
    leg: int,
    box: Box,
    *,
    eps: tuple[float, float] = (0.0, np.inf),
    model: LegModel = PLAIN,
    stated: bool = False,
) -> ConstraintNetwork:
    """The N equations `|g(x, M_k)| <= eps` of leg number `leg` (from 1), each for SOME reading M_k in its set.

    Parameters range over `box` (named as the model's), the model error over `eps`. A leg is longer than eps
    for every reading: `L_k - lambda_k + l >= eps` is part of every model (without its correction, so that each contains
    the plain one). `stated`: as a certificate states it, see `leg_equation`.
    """
    equation = leg_equation(campaign, leg, box, model=model, stated=stated)
    net, scale = equation.network, equation.scale
    error = net.variable("eps", (), eps)
    body, bound = (value if scale is None else scale * value for value in (equation.body, error))
    net.add(body.within((-bound, bound)))
    k = leg - 1
    shortest = IntervalArray.around(campaign.length[:, k], campaign.length_radius[:, k]).lo
    net.add(equation.offset + shortest >= error)
    return net


class LegEquation(NamedTuple):
    """`body` is g (N,), to be multiplied by `scale` (N,) if there is one, over the parameters: all of `network`."""

    network: ConstraintNetwork
    body: Expr
    offset: Expr
    scale: Expr | None


def leg_equation(
    campaign: Campaign, leg: int, box: Box, *, model: LegModel = PLAIN, stated: bool = False
) -> LegEquation:
    """The equation of a leg, without a tolerance yet.

    Exact readings in a user-defined model: all is to be multiplied by `scale` = |q|^2, so that a certificate can
    state it in dyadic numbers. `stated`: rotations and scale are then rational expressions of the quaternions, exactly;
    otherwise enclosures, which is the same constraint in less time.
    """
    k, net = leg - 1, ConstraintNetwork()
    a = net.variable("a", 3, (box.lo[:3], box.hi[:3]))
    b = net.variable("b", 3, (box.lo[3:6], box.hi[3:6]))
    offset = net.variable("l", (), (box.lo[6], box.hi[6]))
    extra = {p.name: net.variable(p.name, (), (box.lo[i], box.hi[i])) for i, p in enumerate(model.extra, start=7)}
    position = net.reading(campaign.position, campaign.position_radius)
    length = net.reading(campaign.length[:, k], campaign.length_radius[:, k])
    scale = None
    scaled = not built_in(model) and exactly_read(campaign, leg)
    if scaled and stated:
        matrix, scale = rational_rotations(as_expr(campaign.quaternion))
    else:
        matrix = _enclosed_rotations(campaign.quaternion.tobytes())
        if scaled:
            scale = net.constant(IntervalArray.point(campaign.quaternion).sqr().sum(1))
    radius = campaign.rotation_radius
    s = net.reading(np.zeros_like(radius), 0.5 * radius) if radius.any() else None  # |2 s_i| <= radius_i

    def rotate(u: ArrayLike | Expr) -> Expr:
        v = matrix @ (u if isinstance(u, Expr) else as_expr(floats(u)))
        return v if s is None else turned_rows(s, v)

    measured = Measured(position, length, position + rotate(b) - a, rotate, partial(drawn, campaign, leg))
    return LegEquation(net, model.equation(measured, offset, extra), offset, scale)


def drawn(campaign: Campaign, leg: int) -> Drawn:
    """The leg with that number (from 1) as the drawing has it at the stated readings."""
    robot, k = campaign.robot, leg - 1
    vector = leg_vectors(robot, campaign.poses)[:, k]
    normal = np.linalg.svd(robot.base - robot.base.mean(axis=0))[2][-1]
    up = np.asarray(normal * np.sign(normal @ (campaign.position.mean(axis=0) - robot.base.mean(axis=0))))
    return Drawn(vector, campaign.length[:, k], float(robot.offset[k]), up)


def exactly_read(campaign: Campaign, leg: int) -> bool:
    """Whether every reading set of the leg is a single point."""
    radii = (campaign.position_radius, campaign.rotation_radius, campaign.length_radius[:, leg - 1])
    return not any(r.any() for r in radii)


def turned_rows(s: Expr, v: Expr) -> Expr:
    """`R(1, s) v`, row by row: v + 2 (s x v + s x (s x v)) / (1 + s.s)."""
    once = cross(s, v)
    return v + 2.0 * (once + cross(s, once)) / (1.0 + sqr(s).sum(-1))[:, None]


Vectors = TypeVar("Vectors", Expr, IntervalArray)


def cross(x: Vectors, y: Vectors) -> Vectors:
    """Of vectors (..., 3) and (..., 3)."""
    return x[..., FORTH] * y[..., BACK] - x[..., BACK] * y[..., FORTH]


def rational_rotations(q: Expr) -> tuple[Expr, Expr]:
    """The matrices R(q) (N, 3, 3) of quaternions (N, 4), scalar first, as exact expressions, and |q|^2 (N,)."""
    rows, scale = rotation_numerators(q[:, k, None, None] for k in range(4))
    units = np.eye(9).reshape(3, 3, 1, 3, 3)
    numerators = sum((rows[i][j] * units[i, j] for i in range(3) for j in range(3)), as_expr(0.0))
    return numerators / scale, scale[:, 0, 0]


@lru_cache(maxsize=1)  # the legs of a campaign have them in common
def _enclosed_rotations(quaternions: bytes) -> Expr:
    return as_expr(rotations(IntervalArray.point(np.frombuffer(quaternions).reshape(-1, 4))))


def rotations(quaternion: IntervalArray) -> IntervalArray:
    """R(q) (..., 3, 3), divided by |q|^2, of quaternions (..., 4), scalar first."""
    rows, norm_squared = rotation_numerators([quaternion[..., k] for k in range(4)])
    entries = [entry / norm_squared for row in rows for entry in row]
    shape = (*quaternion.shape[:-1], 3, 3)
    lo, hi = (np.stack([getattr(one, side) for one in entries], -1).reshape(shape) for side in ("lo", "hi"))
    return IntervalArray(lo, hi)


def beyond_legs(campaign: Campaign, leg: int, offset: float, error: float, what: str) -> list[Problem]:
    """Whether an `error` (mm) is as large as the leg is long at some reading, with the `offset` l; `what` it is called.

    The model takes legs to be longer than the error: at such a one nothing is left of what is asked about.
    """
    radius = campaign.length_radius[:, leg - 1]
    shortest = float(np.min(campaign.length[:, leg - 1] - radius)) + offset
    if 0.0 <= error < shortest or error == 0.0:
        return []
    said = f"{as_stated(error)} mm is no error of leg {leg}, which is {nearest(shortest, 1)} mm long at its shortest"
    return [Problem(what, said, "give one below the lengths of the legs")]


# ------------------------------------------------------------------------------------------------------------------
# One leg of a campaign as a certificate states it.


def leg_readings(campaign: Campaign, leg: int) -> tuple[Floats, Floats]:
    """What the checker reads of one leg (from 1): quaternions, positions and lengths (N, 8); the half-widths (N, 7) of
    positions, rotations and lengths."""
    column = slice(leg - 1, leg)
    given = np.concatenate([campaign.quaternion, campaign.position, campaign.length[:, column]], axis=1)
    radii = [campaign.position_radius, campaign.rotation_radius, campaign.length_radius[:, column]]
    return given, np.concatenate(radii, axis=1)


def leg_statement(
    campaign: Campaign,
    leg: int,
    only: Places | None = None,
    model: str = PLAIN.name,
    forms: tuple[Given, ...] = (),
) -> Statement:
    """Leg `leg` (from 1) with all measurements, or with `only` those (numbers from 0, ascending), and with `forms`.

    `model` is the name of one that comes with cpcal: those the checker knows.
    """
    stated = [polynomial(form, free) for form in forms]
    given, radii = (part.tolist() for part in leg_readings(campaign, leg))

    def exact(k: int) -> Measurement:
        return Measurement(given[k], radii[k])

    problem = leg_problem(exact, len(campaign), model, only, stated)
    return stated_leg(problem, campaign_sha256(campaign), leg, only, forms)


def of_measurements(network: ConstraintNetwork, only: Sequence[int] | None) -> ConstraintNetwork:
    """The equations of some measurements of a leg, numbers from 0; None: all."""
    if only is None:
        return network
    return restricted(network, [np.array(only, np.intp)] * len(network.constraints))


def model_statement(
    campaign: Campaign, leg: int, model: LegModel, domain: Box, only: Places | None = None
) -> Statement | None:
    """What a certificate says: for a model that comes with cpcal the leg, for others the constraints themselves.

    `domain` holds the parameters and, last, eps. None where constraints have no exact polynomial form, as those of a
    user-defined model with uncertain readings.
    """
    if built_in(model):
        return leg_statement(campaign, leg, only, model.name)
    if not exactly_read(campaign, leg):
        return None
    box, eps = Box(model.parameters, domain.lo[:-1], domain.hi[:-1]), (float(domain.lo[-1]), float(domain.hi[-1]))
    network = of_measurements(leg_network(campaign, leg, box, eps=eps, model=model, stated=True), only)
    try:
        return network_statement(network, "eps", f"leg {leg}, model {model.name}, campaign {campaign_sha256(campaign)}")
    except NotStated:
        return None


# ------------------------------------------------------------------------------------------------------------------
# Residuals, derivatives and least-squares fit of any leg model, from its expression. They prove nothing.

_TOLERANCE = 1e-8  # of the fit, relative: it proves nothing


class ModelResiduals:
    """g (N,) in mm and its Jacobian (N, n) at points x (n,) of one leg, at the centres of the reading sets."""

    def __init__(self, campaign: Campaign, leg: int, model: LegModel) -> None:
        self._plain = LegEquations.of(campaign, [leg]) if model.name == PLAIN.name else None
        if self._plain is None:
            still, box = _with_sets(campaign, 0.0), leg_box(np.zeros(7), 0.0, model)
            equation = leg_equation(still, leg, box, model=model)
            equation.network.add(equation.body <= 0.0)
            self._rows = Rows(equation.network)

    def values(self, x: ArrayLike) -> Floats:
        at = floats(x)
        return self._rows.linearize(at).values if self._plain is None else self._plain.values(at[None])[:, 0]

    def jacobian(self, x: ArrayLike) -> Floats:
        at = floats(x)
        return self._rows.linearize(at).jacobian if self._plain is None else self._plain.by_parameters(at[None])[:, 0]


def _with_sets(campaign: Campaign, factor: float) -> Campaign:
    """With half-widths of `factor` times those stated, rounded up."""
    radii = {name: factor * getattr(campaign, name) for name in ("position_radius", "rotation_radius", "length_radius")}
    wider = {name: np.nextafter(radius, np.inf) * (radius > 0.0) for name, radius in radii.items()}
    return campaign if factor == 1.0 else replace(campaign, uncertainty=None, **wider)


def model_residuals(campaign: Campaign, leg: int, x: ArrayLike, model: LegModel = PLAIN) -> Floats:
    """`g(x, M_k)` in mm (N,) at the centres of the reading sets, in plain floating point."""
    return ModelResiduals(campaign, leg, model).values(x)


def fit_model(
    campaign: Campaign,
    leg: int,
    model: LegModel = PLAIN,
    weight: Floats | None = None,
) -> Floats:
    """Parameters (n,) that minimise the sum of squares of g, the extra ones within their half-widths of 0.

    From the fit of the plain model, with which it begins. `weight` (N,): g is multiplied by it.
    """
    plain = ModelResiduals(campaign, leg, PLAIN)
    nominal = campaign.robot.parameters[leg - 1]
    of_plain = least_squares(plain.values, plain.jacobian, nominal, tolerance=_TOLERANCE)
    start = np.append(of_plain.at, np.zeros(len(model.extra)))
    free = np.append(np.ones(7, bool), model.half_widths > 0.0)
    if weight is None and free.sum() == 7:
        return start
    of = ModelResiduals(campaign, leg, model)
    reach, each = np.append(np.full(7, np.inf), model.half_widths), np.ones(len(campaign)) if weight is None else weight

    def slopes(x: Floats) -> Floats:
        return np.asarray(each[:, None] * free * of.jacobian(x))

    while True:  # an extra parameter that leaves its half-width stays at its end
        found = least_squares(lambda x: each * of.values(x), slopes, start, tolerance=_TOLERANCE)
        beyond = np.abs(found.at) > reach
        if not beyond.any():
            return found.at
        start, free = np.clip(found.at, -reach, reach), free & ~beyond


def reading_range(campaign: Campaign, leg: int, model: LegModel, x: Floats, factor: float = 1.0) -> IntervalArray:
    """PROVED: lower and upper bounds (N,) in mm of g at x (n,) over ALL readings of sets `factor` times as wide;
    infinite where nothing is. By interval evaluation, so too wide where g holds a reading more than once."""
    equation = leg_equation(_with_sets(campaign, factor), leg, leg_box(x, 0.0, model), model=model)
    tape = Tape(equation.network, [equation.body])
    slots = tape.forward(IntervalArray.point(floats(x)[None]))
    if tape.continuous(slots):
        return tape.values(slots)[0]
    return IntervalArray(np.full(len(campaign), -np.inf), np.full(len(campaign), np.inf))


def reading_moves(campaign: Campaign, leg: int, x: ArrayLike) -> Floats:
    """(N, 7) mm: how far the half-widths of x, y, z, the three turns and the length move g of the plain model at
    (a, b, l), to first order."""
    by_pose = LegEquations.of(campaign, [leg]).by_pose(floats(x)[None, :7])[:, 0]
    radius = np.concatenate([campaign.position_radius, campaign.rotation_radius], axis=1)
    return np.column_stack([np.abs(by_pose) * radius, campaign.length_radius[:, leg - 1]])
