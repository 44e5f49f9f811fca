"""Leg models: the plain one of the paper, and corrections of it with more parameters (the paper's future work).

With v = P + R b - a and measured (P, R, L), every model is

    g(x, M) = sqrt(||v||^2 - h(x, M)) - (L + l + t(x, M))        in mm

where the plain model has h = t = 0. A model's extra parameters vanish when there is nothing to correct, so every model
contains the plain one: its smallest eps is never larger.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cpcal.calibration.diagnosis import mid_range, sag_shape
from cpcal.common.errors import InputError, ModelError, PluginError, Problem
from cpcal.common.values import Floats
from cpcal.files.codec import INFORMED, checked
from cpcal.solver.network import Expr, norm, sqr, sqrt
from cpcal.solver.network.expression import as_expr

PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")


@dataclass(frozen=True)
class Parameter:
    """An extra parameter of a leg model; it is looked for within `half_width` (in `unit`) of 0."""

    name: str = field(metadata=checked("the unknown of the certificates"))
    unit: str = field(metadata=INFORMED)
    half_width: float = field(metadata=checked("the box of each certificate"))


@dataclass(frozen=True, eq=False)
class Drawn:
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
    `vector` (N, 3): v = P + R b - a, mm, which holds unknowns. `drawn`: numbers of the drawing and the stated readings.
    """

    position: Expr
    length: Expr
    vector: Expr
    rotate: Callable[[npt.ArrayLike], Expr]
    drawn: Drawn


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
    def parameters(self) -> tuple[str, ...]:
        """All names: the seven of the plain model first."""
        return (*PARAMETERS, *(p.name for p in self.extra))

    @property
    def half_widths(self) -> npt.NDArray[np.float64]:
        """Of the extra parameters, in their units."""
        return np.array([p.half_width for p in self.extra], dtype=np.float64)

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
        found = function(measured, extra)
        if not isinstance(found, Expr) or found.shape not in ((), measured.length.shape):
            shape = measured.length.shape
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


def _linear(measured: Measured, x: Parameters) -> Expr:
    position = sum((measured.position[:, i] * x[f"c{axis}"] for i, axis in enumerate("xyz")), as_expr(0.0))
    rotation = sum((turn * x[f"t{axis}"] for turn, axis in zip(_turns(measured), "xyz", strict=True)), as_expr(0.0))
    return _gain(measured, x) + position + rotation


def _turns(measured: Measured) -> list[Expr]:
    """sin(angle) times the axis of the rotation: (R e_j)_k - (R e_k)_j over 2, which is linear in R."""
    columns = [measured.rotate(column) for column in np.eye(3)]
    return [0.5 * (columns[j][:, k] - columns[k][:, j]) for j, k in ((1, 2), (2, 0), (0, 1))]


def _lateral(measured: Measured, x: Parameters) -> Expr:
    return x["h"]


_GAIN = Parameter("s", "mm/mm", 0.05)

PLAIN = LegModel("plain", "L + l: the distance of the joint centres is what the sensor reads, and an offset")
GAIN = LegModel("gain", "L (1 + s) + l: the sensor of the leg has a gain error s", (_GAIN,), _gain)
LINEAR = LegModel(
    "linear",
    "L (1 + s) + l + c.P + t.r: of first order in all that is measured, with r = sin(angle) times the axis of R",
    (_GAIN, *(Parameter(f"c{i}", "mm/mm", 0.05) for i in "xyz"), *(Parameter(f"t{i}", "mm", 20.0) for i in "xyz")),
    _linear,
)
LATERAL = LegModel(
    "lateral",
    "L + l beside a lateral offset between the joint centres: ||v||^2 = (L + l)^2 + h (h < 0 corrects the other way)",
    (Parameter("h", "mm^2", 900.0),),
    square=_lateral,
)

BUILT_IN = (PLAIN, GAIN, LINEAR, LATERAL)


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
    problems: list[Problem] = []
    names = [p.name for p in model.extra]
    wrong = model_name_problem(model.name)
    if wrong:
        problems.append(Problem("model", wrong, "choose another name"))
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

GROUP = "cpcal.leg_models"


def leg_model(model: str | LegModel) -> LegModel:
    """The model of that name, or the model given.

    Raises InputError with everything that is wrong with the name or the model, PluginError when the package that
    provides it does not load.
    """
    if isinstance(model, str):
        ours = {m.name: m for m in BUILT_IN}
        model = ours[model] if model in ours else _provided(model)
    problems = [] if built_in(model) else model_problems(model)
    if problems:
        raise InputError(problems)
    return model


def _provided(name: str) -> LegModel:
    from cpcal.solver import plugins  # here: models that come with cpcal need none

    known = plugins.found(GROUP)
    if name not in known:
        names = ", ".join(dict.fromkeys([*(m.name for m in BUILT_IN), *known]))
        remedy = f"use one of {names}, pass a LegModel, or install the package that provides it (entry point {GROUP})"
        raise InputError([Problem("model", f"{name!r} is not known", remedy)])
    model = plugins.load_member("leg model", name, GROUP)
    if not isinstance(model, LegModel) or model.name != name:
        raise PluginError(f"leg model {name!r} ({known[name].value}) is no cpcal.LegModel of that name")
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


def _sag(measured: Measured, x: Parameters) -> Expr:
    drawn = measured.drawn
    middle = drawn.offset + float(mid_range(drawn.length))
    return -1.0 * (x["c"] * as_expr(sag_shape(drawn.vector, drawn.length + drawn.offset, middle, drawn.up)))


SAG = LegModel(
    "sag",
    "L + l - c (length / mid-range length)^7 sin(tilt)^2: the leg's weight bends it, c is what it loses lying flat",
    (Parameter("c", "mm", 10.0),),
    _sag,
)
