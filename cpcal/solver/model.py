"""The verbs on a network: contract, solve, minimize. `cpcal.Network` is what users write."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from copy import copy
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from cpcal.checker.polynomial import Terms
from cpcal.common import numbers
from cpcal.common.errors import ModelError
from cpcal.common.files import StrPath, listed
from cpcal.common.numbers import stated
from cpcal.common.values import ArrayLike, Floats, Names, all_finite
from cpcal.solver import plugins
from cpcal.solver.accounts import row_use
from cpcal.solver.certificate.exact_network import ExactPolynomials, NotStated, network_statement
from cpcal.solver.certificate.recording import Recording, SearchKeeper, certified
from cpcal.solver.compiled import TimeUp, compiling_until
from cpcal.solver.contract import (
    Contraction,
    Contractor,
    Limits,
    Named,
    Strategy,
    StrategyFactory,
    Then,
    Verdict,
    contracted,
    givers,
)
from cpcal.solver.execution.checkpoint_file import Checkpoint
from cpcal.solver.execution.executors import Here, Place, executor_for, linear_algebra_on_one_thread
from cpcal.solver.execution.stopping import heard
from cpcal.solver.existence.operators import Equalities
from cpcal.solver.existence.unique import Inside, UniquenessProver, reads
from cpcal.solver.interval import Box
from cpcal.solver.interval.numbers import float_bounds
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, PolynomialForms, evaluate
from cpcal.solver.network.expression import as_expr, topological
from cpcal.solver.network.forms import with_products
from cpcal.solver.optimize.bound import Minimum, Progress, minimize, run
from cpcal.solver.search.passes import STRATEGIES, Contracting, Divide
from cpcal.solver.search.paving import Paving, Solution, conclusion
from cpcal.solver.search.race import Contender, Race, checkpoint_of, raced
from cpcal.solver.search.search import ORDERS, Observer, Search

if TYPE_CHECKING:
    from distributed import Client

# ------------------------------------------------------------------------------------------------------------------
# What the verbs on a network are asked with, checked and put in the solver's own terms. Raises ModelError.

FINE_WIDTH = 1e-6  # of the boxes about single points
REACH = 100.0  # from 0, of boxes that are divided where solutions may run to infinity and nobody asks for a width
_BOXES = 256  # about as many make up the set of solutions, or some times as many
_DIVISIONS = 1000.0

N = TypeVar("N", bound=ConstraintNetwork)


def relaxed(network: N, relax: float) -> N:
    """Equations between the same bounds, wider by `relax` on both sides."""
    if not _is_number(relax) or not 0.0 <= relax < np.inf:
        raise ModelError(f"relax={relax!r} is no tolerance: give a number of at least 0")
    if not relax:
        return network
    out = copy(network)
    low, high = as_expr(-float(relax)), as_expr(float(relax))
    out._constraints = [Constraint(c.body - c.lower, low, high) if c.is_equation else c for c in network.constraints]
    return out


def with_objective(network: N, objective: Expr) -> tuple[N, str]:
    """A network of whose components the objective is one, and the component's name."""
    if not isinstance(objective, Expr) or objective.shape != () or objective.op in ("variable", "index"):
        return network, network.component(objective)
    network.check_owner(objective)
    bounds = evaluate(network, objective, network.domain)
    name = "objective"
    while any(leaf.name == name for leaf in network.variables):
        name += "_"
    nowhere = bool(bounds.empty)  # it has a value: then no point satisfies the row below
    bound = network.variable(name, domain=(0.0, 0.0) if nowhere else (float(bounds.lo), float(bounds.hi)))
    network.add(objective <= bound)
    return network, name


def resolution(
    network: ConstraintNetwork, left: Callable[[], Box], width: float | None
) -> tuple[float, Floats, Floats]:
    """Below which width boxes are not divided, how far from 0 they are, and the unit of each component's width (n,).

    Where no width is asked for it is 1e-6 where solutions are single points; else what cuts `left`, which holds them,
    into some hundred boxes or more. Solutions that leave `freedom` of the unknowns open form a set of that dimension:
    each of its directions gets its share of the boxes. Where `left` is unbounded, boxes are divided up to `REACH`.
    Units are 1 then, or smaller where the whole domain is hardly wider than boxes about points, so that a domain of a
    nanometre is divided, too: a thousand times at least.
    """
    domain, whole, everywhere = network.domain, network.domain.width, np.full(len(network.names), np.inf)
    if width is not None:
        if not _is_number(width) or not width > 0:
            raise ModelError(f"width={width!r} is no width: give a positive number, below which boxes are not divided")
        return float(width), everywhere, np.ones(len(everywhere))
    small = (whole > 0.0) & (whole < _DIVISIONS * FINE_WIDTH)
    unit = np.where(small, whole / (_DIVISIONS * FINE_WIDTH), 1.0)
    free, equations = domain.hi > domain.lo, Equalities.of(network)
    freedom = int(free.sum()) - (0 if equations.reads else equations.count)
    if freedom <= 0:
        return FINE_WIDTH, everywhere, unit
    widths = left().width
    reach = np.where(np.isinf(widths), REACH, np.inf)
    widest = float(np.max(np.minimum(widths, 2.0 * reach) / unit, where=free, initial=0.0))
    if not widest > 0.0:
        return FINE_WIDTH, everywhere, unit
    finest = min(widest * _BOXES ** (-1.0 / freedom), np.inf)
    finest = max(finest, 5e-324)  # of a domain next to the least float it is zero
    return round(finest, -math.floor(math.log10(finest))), reach, unit  # one digit


def checked_limits(limits: Limits | None, **named: float | None) -> Limits:
    """Limits that a search can reach, those `named` among them (fields of `Limits`). Raises ModelError."""
    given_by_name = {field: value for field, value in named.items() if value is not None}
    if limits is None:
        limits = Limits()
    elif not isinstance(limits, Limits):
        raise ModelError(f"limits={limits!r} sets no limit: write cpcal.Limits(seconds=...) or cpcal.Limits(nodes=...)")
    elif given_by_name:
        raise ModelError("limits are given by limits=cpcal.Limits(...) or by their names, not both")
    limits = replace(limits, **given_by_name)  # type: ignore[arg-type]  # checked here
    if not all(value is None or (_is_number(value) and value >= 0) for value in vars(limits).values()):
        raise ModelError(f"{limits!r}: seconds, nodes and gaps are numbers of at least 0")
    return limits


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def named_strategy(
    network: ConstraintNetwork, strategy: str | Strategy, width: float, reach: Floats, unit: Floats
) -> Strategy:
    if not isinstance(strategy, str):
        if not hasattr(strategy, "split"):
            raise ModelError(f"strategy={strategy!r} divides no box: give a name or an object with split(box)")
        return strategy
    if strategy in STRATEGIES:
        return STRATEGIES[strategy](network, width).within(reach, unit)
    make: StrategyFactory = plugins.load(strategy, plugins.STRATEGY_GROUP, STRATEGIES)
    return make(network, width)


# ------------------------------------------------------------------------------------------------------------------
# Which contractors and divisions suit a network, by its structure: what `solve` and `minimize` do without options.

_LIFTED_UNKNOWNS, _LIFTED_PRODUCTS = 40, 1000  # beyond, linear programs of products take too long at each node
_DENSE_UNKNOWNS = 100  # for the linear programs of beaumont, one row and two programs an unknown
_TURNS = 8  # of hc4 and newton alone, where there is lifted
_LIFTED_COEFFICIENTS = 4_000_000  # of one array of expressions, as of a matrix times the unknowns: some 100 MB
_SLICES, _LEAST_SLICE, _LIFTED_SLICE = (2048, 16), 8, 32  # nodes in a turn, a tenth of a second or so
_CUBE = 4000  # of the unknowns: up to there a node takes some ten microseconds
_SHALLOW = {"add", "sub", "neg", "mul", "sqr", "index", "sum", "constant", "variable", "power", "div"}


class SearchMethod(NamedTuple):
    """Contractors, the strategy that divides, and how many nodes of it cost about as much as those of the others.

    It gives way to the others after so many `turns`, and does not begin before the round `begins`.
    """

    contractors: Names
    strategy: str
    slice: int
    turns: int | None = None
    begins: int = 0
    consequences: bool = False  # of the equations, besides them

    @property
    def name(self) -> str:
        besides = " with consequences of the equations" if self.consequences else ""
        return f"{', '.join(self.contractors)}{besides} by {self.strategy}"


CERTIFYING = (("lifted",), "it gives weights")
AS_ASKED = (SearchMethod(("as asked",), "largest", 64),)


class Choice(NamedTuple):
    """The methods that take turns, cheapest first, and why these."""

    methods: tuple[SearchMethod, ...]
    why: str
    consequences: tuple[Constraint, ...] = ()  # what follows from the equations, for the methods that ask for it


def choice_to_solve(network: ConstraintNetwork, deadline: float = math.inf) -> Choice:
    """What to solve a network by; what is not polynomial at `deadline` (of time.monotonic()) counts as not."""
    unknowns = int(np.sum(network.domain.hi > network.domain.lo))
    equations = Equalities.of(network)
    lifted = _lifts(network, deadline)
    if equations.count != unknowns or equations.reads:
        kind = "fewer equations than unknowns" if equations.count < unknowns else "more equations than unknowns"
        why = f"{kind if not equations.reads else 'equations with readings'}: there is nothing for newton to prove"
        return Choice((SearchMethod(("hc4", "lifted") if lifted else ("hc4",), "largest", 64),), why)
    turns = _TURNS if lifted else None
    times = max(1.0, unknowns**3 / _CUBE)  # what newton takes for a box grows with the third power of the unknowns
    quick, slow = (max(_LEAST_SLICE, int(nodes / times)) for nodes in _SLICES)
    methods = [SearchMethod(("hc4", "newton"), "largest", quick, turns)]
    more = consequences(network) if lifted else ()
    if more:
        methods.append(SearchMethod(("hc4", "newton"), "largest", quick, turns, consequences=True))
    if lifted:
        methods.append(SearchMethod(("hc4", "newton", "lifted"), "smear-relative", _LIFTED_SLICE, begins=1))
        methods.append(SearchMethod(("lifted", "newton"), "largest", _LIFTED_SLICE, begins=1))
    else:
        methods.append(SearchMethod(("hc4", "cid", "newton"), "smear-relative", slow, begins=1))
        if unknowns <= _DENSE_UNKNOWNS:
            methods.append(SearchMethod(("hc4", "newton", "beaumont"), "smear-relative", slow, begins=1))
    kind = "polynomial" if lifted else "not polynomial, or with too many products for lifted"
    return Choice(tuple(methods), f"{unknowns} equations in as many unknowns, {kind}", more)


def choice_to_minimize(network: ConstraintNetwork, deadline: float = math.inf) -> tuple[Names, str]:
    """The contractors to minimise by, and why; `deadline` as in `choice_to_solve`."""
    if any(map(reads, network.constraints)):
        return ("lifted",), "readings: lifted takes them at the ends that decide"
    if not _lifts(network, deadline):
        return ("hc4", "beaumont"), "no row is polynomial, or there are too many products for lifted"
    left = [c for c in network.constraints if not c.body.ops <= _SHALLOW]
    if left:
        return ("hc4", "lifted", "beaumont"), f"{len(left)} constraints are not polynomial: beaumont linearises them"
    return ("hc4", "lifted"), "polynomial, or with roots and divisions that are multiplied out"


def _lifts(network: ConstraintNetwork, deadline: float) -> bool:
    """Whether lifted has rows to work on, and not too many products."""
    if any(map(reads, network.constraints)):
        return True
    if len(network.names) > _LIFTED_UNKNOWNS:
        linear_time = all(len(c.body.shape) for c in network.constraints)
        largest = max((node.size for node in topological(c.body for c in network.constraints)), default=0)
        if not linear_time or largest * len(network.names) > _LIFTED_COEFFICIENTS:
            return False
    system = PolynomialForms(network, deadline).on()
    return bool(len(system.origin)) and len(system.monomials) <= _LIFTED_PRODUCTS


# ------------------------------------------------------------------------------------------------------------------
# Equations that follow from a network's polynomial equations, found by eliminating terms between them.
#
# Two equations whose products with monomials share a term give a third without it (an S-polynomial). What comes of it
# by Buchberger's algorithm in whole numbers, stopped early, holds wherever the equations do; the shorter ones of lower
# degree bound the unknowns far better than the sums of large terms they come from (F. Benhamou, L. Granvilliers:
# Automatic generation of numerical redundancies for non-linear constraint solving, Reliable Computing 3, 1997).

_LIMITS = (100, 60, 2000)  # polynomials, terms of one, bits of a coefficient: some milliseconds
_UNKNOWNS, _EQUATIONS, _TERMS, _DEGREE = 30, 60, 60, 12  # of what is tried at all


def consequences(network: ConstraintNetwork) -> tuple[Constraint, ...]:
    """Equations that hold wherever the network's do, with no more terms and of no higher degree.

    Equations that are not polynomial with exact coefficients take no part. Empty where nothing short follows.
    """
    size = len(network.names)
    if size > _UNKNOWNS or not 2 <= Equalities.of(network).count <= _EQUATIONS:
        return ()
    exact, given = ExactPolynomials(network), list[Terms]()
    for root in Equalities.of(network).roots:
        with suppress(NotStated):
            given += [p.terms for p in exact.of(root).ravel() if any(p.terms)]
    if len(given) < 2:
        return ()
    longest, highest = max(map(len, given)), max(len(m) for m in chain.from_iterable(given))
    if longest > _TERMS or highest > _DEGREE:
        return ()
    from flint import Ordering, fmpz_mpoly_ctx, fmpz_mpoly_vec  # here: few problems need it

    context = fmpz_mpoly_ctx.get([f"x{k}" for k in range(size)], Ordering.degrevlex)
    first: Any = fmpz_mpoly_vec([_whole(terms, context, size) for terms in given], context)
    basis, _ = first.buchberger_naive(limits=_LIMITS)
    known = {str(p.primitive()[1]) for p in first}
    short = [p for p in basis if 2 <= len(p) <= longest and p.total_degree() <= highest]
    unknowns = [leaf[index] for leaf in network.variables for index in np.ndindex(leaf.shape)]
    return tuple(_expression(p, unknowns) == 0.0 for p in short if str(p.primitive()[1]) not in known)


def _whole(terms: Terms, context: Any, size: int) -> Any:
    """A polynomial with whole coefficients that has the same zeros."""
    common = math.lcm(*(c.denominator for c in terms.values()))
    return context.from_dict({tuple(m.count(k) for k in range(size)): int(c * common) for m, c in terms.items()})


def _expression(polynomial: Any, unknowns: list[Expr]) -> Expr:
    """Divided by a power of two, so that no coefficient is above 1."""
    scale = 1 << max(int(c).bit_length() for c in polynomial.coeffs())
    terms = (
        math.prod(
            (unknowns[k] ** int(power) for k, power in enumerate(exponents) if power),
            start=as_expr(Fraction(int(coefficient), scale)),
        )
        for exponents, coefficient in polynomial.to_dict().items()
    )
    return sum(terms, as_expr(0.0))


DEFAULT_CONTRACTORS = ("hc4", "lifted")

_LOADS = ("cpcal.solver.model", "cpcal.solver.numba_begun")  # of workers
_ABREAST = 64  # pending boxes that a round of `solve` takes, whatever the order


class Network(ConstraintNetwork):
    """A constraint network that can be solved.

    THERE EXISTS one value of every reading in its set: that is what each answer quantifies over.
    """

    def contract(
        self, box: Box | None = None, *, contractors: Sequence[str | Contractor] = DEFAULT_CONTRACTORS
    ) -> Contraction:
        """One pass of the named contractors over `box` (default: the domain). Loses no solution.

        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        Raises ModelError for a box of other variables, PluginError for a contractor that is not there.
        """
        network = self._as_asked()
        box = network.domain if box is None else box
        network.check_box(box)
        parts = (part for _, part in plugins.build_each(network, contractors))
        return contracted(Then(*parts), box)

    def solve(
        self,
        *,
        width: float | None = None,
        contractors: Sequence[str | Contractor] | None = None,
        limits: Limits | None = None,
        time_limit: float | None = None,
        node_limit: int | None = None,
        progress: Observer | None = None,
        strategy: str | Strategy | None = None,
        order: str = "depth",
        inner: bool = False,
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
        checkpoint: StrPath | None = None,
        resume: bool = False,
    ) -> Paving:
        """Boxes, of components no wider than `width`, that hold all solutions. Ctrl-C ends it early, cleanly.

        Without `width` it is 1e-6 where equations leave single points. Where they leave curves or regions, one is
        chosen that cuts them into some hundred to some thousand boxes, and `Paving.method` says which. Half of it takes
        twice as long along a curve, four times on a surface: set `limits` with it. Where solutions may run to infinity,
        boxes further than 100 from 0 are not divided; with a width that is asked for they are: set `limits`.

        Where there are as many equations as unknowns, boxes are proved to hold exactly one solution if they do.
        Without `contractors` and `strategy` several combinations that suit the network's structure take turns, and the
        first that ends is the answer; `Paving.method` says which and why.
        `strategy` says where a box is cut in two: "largest" or "smear-relative" (or an object); `order` which boxes are
        next, up to 64 abreast: "depth" or "breadth". `inner=True` looks for boxes that hold nothing but solutions,
        which are not divided, and lists what was proved to hold none: see `Paving`. `time_limit` and `node_limit` are
        `limits=Limits(seconds=..., nodes=...)`; the time counts from the call, and when it is over no function is
        compiled any more.

        `workers` processes, a Dask `scheduler` or an `executor` (see `cpcal.certify`) decide the boxes of each round;
        the answer is the same. It pays where a box takes a millisecond or more.

        `checkpoint` names a file that says every few seconds, and at a stop, where the search stands; with `resume` it
        goes on from there, to the answer that it would have had. The file goes when all is decided. Limits are of each
        call. Raises InputError for a file that is cut off, or of another problem or other options.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        Raises PluginError for a contractor or strategy that is not there, ModelError for what has no meaning.
        """
        try:
            limit = checked_limits(limits, seconds=time_limit, nodes=node_limit)
            network, clock = self._as_asked(), limit.clock()
            chooses = contractors is None and strategy is None
            with compiling_until(clock.deadline):
                choice = choice_to_solve(network, clock.deadline) if chooses else Choice(AS_ASKED, "as asked for")
            if order not in ORDERS:
                raise ModelError(f"no order is called {order!r}; there are: {', '.join(ORDERS)}")
            priority, inside = ORDERS[order], Inside(network) if inner else None
            built = dict[SearchMethod, list[Named]]()
            options = (contractors, strategy, order, inner, width)
            of = {} if checkpoint is None else checkpoint_of(network, options)
            keeper = Checkpoint(checkpoint, of, resume=resume)

            def contracting(method: SearchMethod) -> list[Named]:
                names = method.contractors if chooses else DEFAULT_CONTRACTORS if contractors is None else contractors
                rows = copy(network)
                rows.add(choice.consequences if method.consequences else ())
                built[method] = plugins.build_each(rows, names)
                return built[method]

            def left() -> Box:
                parts = (part for _, part in contracting(choice.methods[0]))
                return contracted(Then(*parts), network.domain, clock.deadline).box

            with compiling_until(clock.deadline):
                finest, reach, unit = resolution(network, left, width)

            def search(method: SearchMethod, place: Place) -> Search:
                by = named_strategy(network, strategy or method.strategy, finest, reach, unit)
                every = Contracting(contracting(method), deadline=clock.deadline)
                elsewhere = None if isinstance(place[0], Here) else place
                process = Divide(every, by, inside=inside, outside=inner, place=elsewhere)
                return Search([network.domain], process, priority, abreast=_ABREAST, batch=process.batch)

            there = executor_for(workers, scheduler, executor, loads=_LOADS)
            with heard(), linear_algebra_on_one_thread(), there as place, compiling_until(clock.deadline):
                race = Race(
                    [Contender(m.name, partial(search, m, place), m.slice, m.turns, m.begins) for m in choice.methods]
                )
                nodes = raced(race, keeper, network.names, clock, progress)
                found = race.leader.search or search(choice.methods[0], place)
                (keeper.keep if found.waiting else keeper.done)()
                paving = conclusion(
                    found, UniquenessProver(network, deadline=clock.deadline), clock, nodes, outside=inner
                )
                used = row_use(network, built[choice.methods[race.contenders.index(race.leader)]])
            said = f"{choice.why}: {race.sentence()}" if chooses else choice.why
            if width is None and finest != FINE_WIDTH:
                shape, chosen = "Solutions form curves or regions", f"width {stated(finest)} was chosen"
                said += f" {shape}: {chosen}, width=... asks for another."
                if np.isfinite(reach).any():
                    said += f" They may run to infinity: further than {stated(REACH)} from 0 boxes are not divided."
            return replace(paving, method=said, width=finest, row_use=used)
        except TimeUp as late:
            said = f"Not begun: {late}; the domain holds all solutions."
            return Paving(False, said, (Solution(Verdict.UNKNOWN, self.domain),), 0, method=str(late))

    def minimize(
        self,
        objective: Expr,
        *,
        contractors: Sequence[str | Contractor] | None = None,
        limits: Limits | None = None,
        time_limit: float | None = None,
        node_limit: int | None = None,
        gap: float | None = None,
        start: ArrayLike | None = None,
        progress: Progress = None,
        relax: float = 0.0,
        certificate: StrPath | None = None,
        about: str = "",
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
        checkpoint: StrPath | None = None,
        resume: bool = False,
    ) -> Minimum:
        """The smallest value of `objective`, a scalar expression over this network, bracketed by proofs.

        An expression that is no variable becomes one, "objective", the last of the answer's boxes: it is at least the
        expression, and its first bounds come from interval evaluation. `start` holds one value per component in the
        order of `names`. Raises ModelError for an objective without finite bounds.

        `time_limit`, `node_limit` and `gap` are `limits=Limits(seconds=..., nodes=..., gap=...)`, as in `solve`.

        `relax`: equations need hold to this only, as ibexopt has it (1e-8 there). The answer, and its status, are then
        about the relaxed problem, whose lower bound is one of the problem itself too. 0 asks for exact equations: their
        solutions are proved to exist.

        `certificate` names a file for the proof, which states the constraints exactly, and `about` in words what they
        are. The answer is then what the certificate proves, by the steps of contractors that give weights (lifted);
        others take no part. It is checked before it is written. Where equations hold at no float64 point, it proves the
        lower bound alone: the verdict is NOT_CERTIFIED then. `workers`, `scheduler`, `executor`, `checkpoint` and
        `resume` are as in `solve`; certificates are the same, byte for byte. Constraints with readings or without
        polynomial form raise ModelError. Where it cannot be written, or the checker would refuse it, UncertifiedError
        is raised, whose `answer` is what was found.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        """
        try:
            limit = checked_limits(limits, seconds=time_limit, nodes=node_limit, gap=gap)
            network, clock = self._as_asked(), limit.clock()
            exact, why = certificate is not None, "asked for"
            with compiling_until(clock.deadline):
                network, name = with_objective(relaxed(network, relax), objective)
                stated, origin = with_products(network, instead=exact)
                if contractors is None:
                    contractors, why = CERTIFYING if exact else choice_to_minimize(stated, clock.deadline)
                network._check_bounded(name, contractors, chosen=why != "asked for")
                named = plugins.build_each(stated, contractors, objective=name)
            names = ", ".join(called for called, _ in named)
            if exact and not any(givers(contractor) for _, contractor in named):
                raise ModelError(f"{names} give no weights: no certificate can be written; use lifted")
            first = None
            if start is not None:
                count, (first, _) = len(self.names), float_bounds(start)
                if first.shape != (count,) or not all_finite(first):
                    raise ModelError(
                        f"start={start!r} is no point: give {count} finite numbers, in the order of `names`"
                    )
                first = np.concatenate([first, network.domain.hi[count:]])
            options = (list(contractors), limit.gap, limit.gap_absolute, first, relax, exact)
            of = {} if checkpoint is None else checkpoint_of(network, options)
            recorded = Recording(network_statement(stated, name, about), network.domain) if exact else nullcontext()
            with heard(), recorded as recording:
                keeper = SearchKeeper(checkpoint, of, recording, resume=resume)
                before = keeper.resumed()
                with linear_algebra_on_one_thread(), executor_for(workers, scheduler, executor, loads=_LOADS) as place:
                    left = limit
                    if limit.seconds is not None:
                        left = replace(left, seconds=max(0.0, clock.deadline - time.monotonic()))
                    if limit.nodes is not None and before is not None:
                        left = replace(left, nodes=limit.nodes + before.tally.nodes)
                    states = minimize(
                        network,
                        name,
                        named,
                        limits=left,
                        start=first,
                        prover=None if recording is None else recording.prover,
                        observe=None if recording is None else recording.event,
                        resume=before,
                        keep=keeper,
                        place=None if isinstance(place[0], Here) else place,
                    )
                    found = run(states, progress)
                    keeper.end(found)
                status = found.status + (f" Equations were relaxed to within {numbers.stated(relax)}." if relax else "")
                used = row_use(network, named[: len(contractors)], origin)
                found = replace(found, status=status, relax=float(relax), method=f"{names}: {why}", row_use=used)
                if certificate is not None and recording is not None:
                    found = certified(recording, certificate, found, network.domain, name)
                if not (found.pending or found.interrupted):
                    keeper.done()
                return found
        except TimeUp as late:
            return Minimum(
                lo=-math.inf,
                hi=math.inf,
                verdict=Verdict.UNKNOWN,
                status=f"Not begun: {late}.",
                enclosure=self.domain,
                pending=1,
                names=self.names,
                method=str(late),
            )

    def _as_asked(self) -> Network:
        """A copy, since a callback may add to this network meanwhile. Raises ModelError where there is no variable."""
        if not self.names:
            raise ModelError(
                f"{self.name!r} has no variables: declare one with variable(name) before you ask for values"
            )
        return copy(self)

    def _check_bounded(self, objective: str, contractors: Sequence[str | Contractor], *, chosen: bool) -> None:
        """That all domains are bounded, by the constraints at least; whoever names hc4 answers for that."""
        if "hc4" in contractors and not chosen:
            return
        box = self.contract(contractors=["hc4"]).box if "hc4" in contractors else self.domain
        names = [n for n in self.names if n != objective and not box.is_empty and not box[n].is_bounded]
        if names:
            or_else = "" if chosen else ", or put hc4 first"
            raise ModelError(f"minimize needs bounded domains, and has none for {listed(names)}: give one{or_else}")
