"""Checks a certificate: forms every polynomial again in exact arithmetic, and accepts what is proved.

docs/certificate-format.md is the specification; Refused says what is wrong, and in which line.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction as F
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from .files import A_FILE, WORK, Budget, Lines, opened
from .leg import EXTRA, NAME, ExactCampaign, check_model, leg_problem
from .polynomial import READINGS, Polynomial, Spend, constant, least, substituted, unknown
from .readers import (
    Fractions,
    Json,
    Names,
    Places,
    Reader,
    Refused,
    Unusable,
    anything,
    ascending,
    choice,
    dyadic,
    entry,
    many,
    maybe,
    record,
    shown,
    signs,
    text,
    whole,
)
from .rule import Box, Constraint, Images, Problem, Row, Rule, Unknowns, Weights, hitting_set

# what a certificate claims, and what of it was accepted --------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    """A point with what is proved of it, measurement by measurement; nothing is said of the others.

    It holds for some reading, or with a `factor` for all, with so many times the stated half-widths.
    """

    at: Fractions
    holds: Places
    fails: Places
    factor: F | None = None


@dataclass(frozen=True)
class Claims:
    """What a certificate says of the problem's box.

    `infeasible`: no solution has an objective up to `cap`. `eps_lo`: none has a smaller objective; `eps_hi`: one has
    this. `enclosure`: all with an objective up to `cap` lie there. `point`: see Point.
    """

    cap: F | None
    infeasible: bool = False
    eps_lo: F | None = None
    eps_hi: F | None = None
    enclosure: tuple[Fractions, Fractions] | None = None
    point: Point | None = None


@dataclass(frozen=True)
class Accepted:
    """What a certificate proves, of what, and how much work that was."""

    header: Json  # the first line
    leg: int | None  # None: of constraints that the certificate states itself
    model: str | None  # of the leg
    about: str  # constraints of its own: what they are about, in the certificate's words, which are not checked
    campaign: str | None  # SHA-256 of the campaign.json that was used
    unknowns: Names
    objective: int | None
    count: int  # of measurements or constraints
    chosen: Places  # those that the certificate speaks of
    lo: Fractions
    hi: Fractions
    claims: Claims
    used: frozenset[int]  # measurements with a weight in some step
    steps: int
    last: tuple[tuple[str, int, str], ...] = ()  # rows of the last step
    forms: tuple[tuple[tuple[tuple[int, ...], F], ...], ...] = ()  # polynomials that are unknowns, of a leg


# its first lines: the problem that it speaks of, and its box ---------------------------------------------------------

FORMAT = "cpcal-certificate/6"
Given = tuple[tuple[tuple[int, ...], F], ...]  # a polynomial as a certificate states it: monomials, coefficients
_MOST_UNKNOWNS = 1000
_MOST_CONSTRAINTS = 100_000
_MOST_FORMS = 1000
_MOST_TERMS = 400_000  # of all constraints
_MOST_FIELDS = 100_000_000  # of these terms, each of so many unknowns
_HIGHEST = 8  # degree

_OF_A_LEG = re.compile("leg [0-9]+, model (.*), campaign [0-9a-f]{64}")  # what the certificates of a run say
_BOX = {"lo": many(dyadic), "hi": many(dyadic)}
_POLYNOMIAL = many(entry(many(whole(_MOST_UNKNOWNS)), dyadic))
_FORMS = many(_POLYNOMIAL)
_LEG = record(
    {
        "format": anything,
        "campaign": text,
        "leg": whole(1 << 30, 1),
        "model": choice(*EXTRA),
        "measurements": whole(1 << 30),
        "only": maybe(ascending(1 << 30)),
        **_BOX,
    }
)
_STATED = record(
    {
        "format": anything,
        "about": text,
        "unknowns": many(text),
        "objective": maybe(whole(_MOST_UNKNOWNS)),
        "constraints": whole(_MOST_CONSTRAINTS + 1),
        **_BOX,
    }
)


def problem_of(
    header: Json, lines: Lines, certificate: Path, campaign: Path | ExactCampaign | None
) -> tuple[Problem, Box]:
    """The problem and its box; of a leg by its campaign, else by the lines that follow."""
    if header.get("format") != FORMAT:
        raise Refused(f"the format is not {FORMAT}: certify again with this version of cpcal")
    return _leg(header, lines, certificate, campaign) if "campaign" in header else _stated(header, lines)


def _leg(header: Json, lines: Lines, certificate: Path, given: Path | ExactCampaign | None) -> tuple[Problem, Box]:
    forms: tuple[Given, ...] = ()
    if "forms" in header:
        header = dict(header)
        forms = _FORMS(header.pop("forms"))
    _, digest, leg, model, count, only, lo, hi = _LEG(header)
    own = certificate.parent / f"{digest[:12]}.{NAME}"  # which is named after its digest
    beside = own if digest[:12].isalnum() and own.exists() else certificate.parent / NAME
    campaign = given if isinstance(given, ExactCampaign) else ExactCampaign(given or beside)
    if digest != campaign.sha256:
        raise Refused("the campaign is another one: its SHA-256 differs", "campaign")
    if count != len(campaign) or leg > campaign.legs or (only or (0,))[-1] >= count:
        raise Refused(f"the campaign has {campaign.legs} legs and {len(campaign)} measurements")
    if only == ():
        raise Refused("a certificate of no measurements says nothing")
    if len(forms) > _MOST_FORMS or any(v >= 7 for form in forms for m, _ in form for v in m):
        raise Refused(f"there are at most {_MOST_FORMS} forms, in the first seven unknowns")
    stated = [polynomial(form, lines.spend) for form in forms]
    exact = partial(campaign.unmet, leg) if campaign.exact else None
    problem = leg_problem(lambda k: campaign.measurement(k, leg), count, model, only, stated, exact)
    root = _box(lo, hi, len(problem.unknowns) - len(forms))
    if root.lo[-1] < 0:
        raise Refused("eps is negative in the box of the problem")
    return replace(problem, forms=forms), with_forms(root, stated, lines.spend)


def with_forms(root: Box, forms: Sequence[Polynomial], spend: Spend) -> Box:
    """With a power of two for each form that none of its values on the box is above."""
    most, ends = tuple(max(-a, b) for a, b in zip(root.lo, root.hi, strict=True)), list[F]()
    images = Images(Box(tuple(-v for v in most), most), spend)
    for form in (substituted(form, images) for form in forms):
        largest = -min(least(form, -1), least(form.times(-1), -1))  # the sum of the sizes of its terms
        ends.append(F(1 << largest.__floor__().bit_length()))
    return Box((*root.lo, *(-end for end in ends)), (*root.hi, *ends))


def _stated(header: Json, lines: Lines) -> tuple[Problem, Box]:
    """The problem of the lines that follow, and its box."""
    _, about, names, objective, count, lo, hi = _STATED(header)
    of_a_leg, n = _OF_A_LEG.fullmatch(about), len(names)
    if of_a_leg is not None and of_a_leg[1] in EXTRA:
        raise Refused(f"it states constraints of its own for the model {of_a_leg[1]}, which is one of cpcal's")
    check_model("x" if of_a_leg is None else of_a_leg[1])
    if not 0 < n <= _MOST_UNKNOWNS or len(set(names)) < n or (objective or 0) >= n:
        raise Refused(f"there must be from 1 to {_MOST_UNKNOWNS} unknowns, with names of their own; objective is one")
    root, items, terms = _box(lo, hi, n), [], 0
    given = many(entry(many(whole(n)), dyadic))
    line = record(
        {"name": text, "root": choice(True, False), "body": given, "at_least": maybe(given), "at_most": maybe(given)}
    )
    for _ in range(count):
        _, rooted, *parts = line(lines.following("all constraints"))
        terms += sum(len(part or ()) for part in parts)
        if terms > min(_MOST_TERMS, _MOST_FIELDS // n):
            raise Refused(f"the constraints have more than {_MOST_TERMS} terms", "limit")
        low, high = (None if part is None else polynomial(part, lines.spend) for part in parts[1:])
        factor = constant(F(1), lines.spend) if rooted else None
        items.append(Constraint(polynomial(parts[0], lines.spend), low, high, factor))
    problem = Problem(names, objective, count, tuple(range(count)), lambda k, x, *_: items[k].on(x.images))
    return problem, root


def polynomial(given: Given, spend: Spend) -> Polynomial:
    """Of monomials, as their unknowns, and coefficients."""
    if any(len(m) > _HIGHEST or list(m) != sorted(m) for m, _ in given) or len({m for m, _ in given}) < len(given):
        raise Refused(f"monomials are sorted, of degree at most {_HIGHEST}, and stand once each")
    lowest = max((c.denominator.bit_length() - 1 for _, c in given), default=0)
    terms = {sum(map(unknown, m)): (c.numerator << lowest) // c.denominator for m, c in given}
    return Polynomial(terms, -lowest, spend)


def _box(lo: Fractions, hi: Fractions, size: int) -> Box:
    if {len(lo), len(hi)} != {size}:
        raise Refused(f"a list of {size} is needed here")
    if any(a > b for a, b in zip(lo, hi, strict=True)):
        raise Refused("the box of the problem is empty")
    return Box(lo, hi)


_MOST_OPEN = 100_000  # boxes
_MOST_BOUNDS = 2_000_000  # of all open boxes
_LONG_LINE, _LONG_STEP = 1000, 20_000  # bytes and work of a step: what it leaves is remembered where it takes more


def check(certificate: Path, campaign: Path | ExactCampaign | None = None, *, work: int | Budget = WORK) -> Accepted:
    """Check a certificate, one about a leg against the campaign.json (default: the one beside it).

    Raises Refused, or Unusable where a file cannot be read. `work`: what it may cost, or what is left for a run.
    """
    with opened(certificate) as stream:
        lines = Lines(stream, work if isinstance(work, Budget) else Budget(work))
        return check_lines(lines, lambda header: problem_of(header, lines, certificate, campaign))


def check_lines(lines: Lines, formed: Callable[[Json], tuple[Problem, Box]]) -> Accepted:
    """Check the lines of a certificate about the problem that is `formed` of its header. Raises Refused."""
    try:
        header = lines.following("the header")
        return _Check(lines, *formed(header)).accepted(header)
    except Refused as refused:  # in that line, unless it is known to be elsewhere
        raise Refused(refused.reason, refused.code, lines.line if refused.line is None else refused.line) from None
    except (OverflowError, MemoryError, RecursionError):
        raise Refused("the values are too large, or nested too deeply", "limit", lines.line) from None


class Certificates(ABC):
    """Those of a folder, which may rest on one another: each is checked once, all of them within one budget."""

    most = 10_000

    def __init__(self, folder: Path, budget: Budget) -> None:
        self.folder, self.budget = folder, budget
        self.known: dict[str, Accepted | Refused] = {}

    @abstractmethod
    def form(self, header: Json, lines: Lines) -> tuple[Problem, Box]:
        """The problem and its box."""

    @property
    def names(self) -> set[str]:
        return {path.name for path in self.folder.glob("*.cert.jsonl")}

    def accepted(self, name: Any) -> Accepted:
        """What a file proves. Raises Refused."""
        file = text(name)
        if file not in self.known and file not in self.names:
            raise Refused(f"names no certificate of its folder: {shown(file)}")
        if file not in self.known:
            if len(self.known) == self.most:
                raise Refused(f"it has more than {self.most} certificates", "limit")
            self.known[file] = Refused(f"names {shown(file)}, which rests on itself")
            try:
                with opened(self.folder / file) as stream:
                    lines = Lines(stream, self.budget)
                    lines.spend(A_FILE)
                    self.known[file] = check_lines(lines, partial(self.form, lines=lines))
            except (Refused, Unusable) as error:
                code = error.code if isinstance(error, Refused) else "run"
                self.known[file] = Refused(f"names {shown(file)}, which is refused: {error}", code, 0)
        found = self.known[file]
        if isinstance(found, Refused):
            raise found
        return found

    def names_all(self, named: Collection[str]) -> None:
        """Raises Refused for a certificate in the folder that nothing names."""
        if unnamed := self.names.difference(named):
            raise Refused(f"does not name the certificate {shown(min(unnamed))}, which lies beside it")


def _schema(problem: Problem) -> dict[str, Reader]:
    """Readers of the claims, and of each kind of step by the key that names it."""
    n, reading = len(problem.unknowns), READINGS if problem.model else 0
    unknown, vector, sign, weight = whole(n), many(dyadic, n), choice(1, -1), whole(1 << 60)
    row = entry(choice(*problem.sides), whole(problem.count), signs(reading), defaults=("0" * reading,))
    exponent, name, cap = whole(1000, -1000), whole(1 << 60), maybe(dyadic)
    fields = {
        "rows": many(entry(whole(1 << 30), weight)),
        "products": many(entry(unknown, unknown, sign, sign, weight)),
        "tangents": many(entry(unknown, dyadic, weight)),
        "exponents": entry(exponent, exponent, exponent),
    }
    weights, rows = record(fields), many(row)
    if problem.wrong:
        weights = many(weights)
    readings = maybe(many(signs(reading)))
    point = {"at": vector, "holds": anything, "readings": readings, "factor": maybe(dyadic), "fails": rows}
    claims = {
        "cap": cap,
        "infeasible": choice(True, False),
        "epsilon": maybe(record({"lo": dyadic, "hi": maybe(dyadic)})),
        "enclosure": maybe(record({"lo": vector, "hi": vector})),
        "point": maybe(record(point)),
    }
    bound = entry(unknown, choice("lo", "hi"), dyadic, weights)
    return {
        "claims": record(claims),
        "pass": record({"pass": name, "cap": cap, "rows": rows, "bounds": many(bound)}),
        "exclude": record({"exclude": name, "cap": cap, "rows": rows, "weights": weights}),
        "split": record({"split": name, "unknown": unknown, "at": dyadic, "into": entry(name, name)}),
    }


class _Check:
    """One pass over the lines; holds the problem, the open boxes and nothing else that grows."""

    def __init__(self, lines: Lines, problem: Problem, root: Box) -> None:
        self.lines, self.problem, self.root = lines, problem, root
        self.chosen, self.schema = frozenset(problem.chosen), _schema(problem)
        self.open, self.used = {0: root}, set[int]()
        self.steps, self.next_name = 0, 1
        self.last: tuple[Row, ...] = ()

    def accepted(self, header: Json) -> Accepted:
        p = self.problem
        self.about = header.get("campaign"), header.get("leg"), p.model, p.chosen, p.forms
        self.claims = self._claims(self.lines.following("the claims"))
        for step in self.lines:
            self.steps += 1
            self.lines.spend(len(self.root.lo))
            self._step(step)
        for name, box in self.open.items():
            self._concluded(name, box)
        return Accepted(
            header=header, leg=header.get("leg"), model=p.model, about=header.get("about", ""),
            campaign=header.get("campaign"), unknowns=p.unknowns, objective=p.objective, count=p.count, chosen=p.chosen,
            lo=self.root.lo, hi=self.root.hi, claims=self.claims, used=frozenset(self.used), steps=self.steps,
            last=self.last, forms=p.forms,
        )  # fmt: skip

    # the claims ---------------------------------------------------------------------------------------------------

    def _claims(self, value: Json) -> Claims:
        cap, infeasible, epsilon, hull, given = self.schema["claims"](value)
        self._check_cap(cap)
        o, (lo, hi) = self.problem.objective, epsilon or (None, None)
        least = None if o is None else self.root.lo[o]
        if lo is not None and (least is None or not least <= lo <= cap or (self.problem.model and least != 0)):
            raise Refused("eps_lo lies between the least eps of the problem, which is 0 for a leg, and cap")
        point = None if given is None else self._point(*given)
        attained = False
        if o is not None and point is not None and point.factor is None:
            everywhere = self.root.holds(point.at, point.at) and point.holds == self.problem.chosen
            attained = everywhere and point.at[o] == hi
        if hi is not None and not (lo <= hi and attained):
            raise Refused("eps_hi is not proved: no point of the box with it satisfies every measurement", "proof")
        return Claims(cap, infeasible, lo, hi, None if hull is None else tuple(hull), point)

    def _check_cap(self, cap: F | None) -> None:
        o = self.problem.objective
        if (cap is None) != (o is None):
            raise Refused("there is a cap if and only if there is an objective")
        if cap is not None and o is not None and not self.root.lo[o] <= cap <= self.root.hi[o]:
            raise Refused("the cap is not an eps of the problem")

    def _point(self, at: Fractions, holds: Any, readings: Any, factor: F | None, fails: tuple[Row, ...]) -> Point:
        p, x = self.problem, Unknowns(Box(at, at), self.lines.spend)
        good = p.chosen if holds == "all" else ascending(p.count)(holds)
        bad = tuple(k for _, k, _ in fails)
        if len(set(bad)) < len(bad):
            raise Refused("a measurement stands twice in fails")
        if readings is None:
            readings = ("0" * (READINGS if p.model else 0),) * len(good)
        elif factor is not None:
            raise Refused("of a point that holds for all readings none are named")
        if len(readings) != len(good) or not self.chosen.issuperset((*good, *bad)):
            raise Refused("readings are those of the measurements in holds, none of which is left out")
        if factor is not None and not 0 <= factor <= 1:
            raise Refused("the factor on the half-widths is from 0 to 1")
        k = p.unproved(x, list(zip(good, readings, strict=True)), factor)
        if k is not None:
            which = "" if factor is None else " for all readings"
            raise Refused(f"it is not proved that the point satisfies measurement {k}{which}", "proof")
        for row in fails:
            if not p.fails(x, *row):
                raise Refused(f"it is not proved that the point fails at measurement {row[1]}", "proof")
        return Point(at, good, bad, factor)

    # the steps ----------------------------------------------------------------------------------------------------

    def _step(self, step: Json) -> None:
        kind = next((kind for kind in ("pass", "exclude", "split") if kind in step), None)
        if kind is None:
            raise Refused("is neither a pass, nor an exclusion, nor a split")
        name, *given = self.schema[kind](step)
        if name not in self.open:
            raise Refused(f"no box {name} is open")
        box = self.open.pop(name)
        if kind == "split":
            self._split(box, *given)
            return
        cap, rows, what = given
        proofs = what if kind == "pass" else [[what]]
        several = bool(self.problem.wrong)
        bounds = [(*b, tuple(Weights(*w) for w in (sets if several else (sets,)))) for *b, sets in proofs]
        left = self._known(self._capped(box, cap), rows, bounds)
        if left is not None:
            self.open[name] = left

    def _capped(self, box: Box, cap: F | None) -> Box | None:
        """The box with its objective cut at `cap`; None when that leaves nothing."""
        self._check_cap(cap)
        o = self.problem.objective
        if cap is None or o is None or self.claims.cap is None:
            return box
        if cap < self.claims.cap:
            raise Refused("a cap is below that of the claims")
        return box.replaced(o, hi=min(box.hi[o], cap)) if box.lo[o] <= cap else None

    def _known(self, box: Box | None, rows: tuple[Row, ...], proofs: list[tuple[Any, ...]]) -> Box | None:
        """As `_proved`, at once where another certificate about the same problem took this step from the same box."""
        spoken = [k for _, k, _ in rows]
        if not self.chosen.issuperset(spoken):
            raise Refused("a measurement that is left out has a weight")
        if any(n >= len(rows) for *_, sets in proofs for weights in sets for n, _ in weights.rows):
            raise Refused("a weight is on a row that the step has not")
        self.used.update(spoken)
        self.last = rows
        if box is None:
            return None
        budget, text = self.lines.budget, self.lines.text
        if not self.problem.model or len(text) < _LONG_LINE:
            return self._proved(box, rows, proofs)
        key, before = (self.about, box, sha256(text).digest()), budget.left
        if key in budget.known:
            found: Box | None = budget.known[key]
            return found
        found = self._proved(box, rows, proofs)
        if before - budget.left > _LONG_STEP:
            budget.known[key] = found
        return found

    def _proved(self, box: Box, rows: tuple[Row, ...], proofs: list[tuple[Any, ...]]) -> Box | None:
        """What is left of the box with the bounds that are proved; an exclusion is a proof without a bound."""
        rule, lo, hi = Rule(self.problem, box, rows, self.lines.spend), list(box.lo), list(box.hi)
        rule.form(n for *_, sets in proofs for weights in sets for n, weight in weights.rows if weight)
        for *bound, sets in proofs:
            if self.problem.wrong:
                tags = ({self.problem.tag(*rows[n][:2]) for n, weight in one.rows if weight} for one in sets)
                family = {frozenset(tag for tag in found if tag is not None) for found in tags}
                if hitting_set(family, self.problem.wrong, self.lines.spend) is not None:
                    raise Refused("so many wrong dots could spoil all of its weights", "proof")
            if not bound:
                if all(map(rule.excludes, sets)):
                    return None
                raise Refused("the weights do not exclude the box", "proof")
            i, side, value = bound
            for weights in sets:
                self.lines.spend(300)
                proved = rule.bound(i, side, weights)
                if proved < value if side == "lo" else proved > value:
                    if self.problem.wrong and rule.excludes(weights):  # which proves any bound
                        continue
                    raise Refused(f"the weights prove less than the bound on unknown {i}", "proof")
            if side == "lo":
                lo[i] = max(lo[i], value)
            else:
                hi[i] = min(hi[i], value)
        return None if any(lo[i] > hi[i] for i, *_ in proofs) else Box(tuple(lo), tuple(hi))

    def _split(self, box: Box, i: int, cut: F, into: tuple[int, int]) -> None:
        if into != (self.next_name, self.next_name + 1):
            raise Refused(f"new boxes are named in order; the next is {self.next_name}")
        if not box.lo[i] <= cut <= box.hi[i]:
            raise Refused("the cut is outside the box")
        if len(self.open) + 2 > min(_MOST_OPEN, _MOST_BOUNDS // len(box.lo)):
            raise Refused("too many boxes are open", "limit")
        self.next_name += 2
        self.open |= {into[0]: box.replaced(i, hi=cut), into[1]: box.replaced(i, lo=cut)}

    # the conclusions ----------------------------------------------------------------------------------------------

    def _concluded(self, name: int, box: Box) -> None:
        """Whether the claims leave room for the solutions in an open box."""
        claims, o = self.claims, self.problem.objective
        if o is not None and claims.cap is not None:
            if box.lo[o] > claims.cap:
                return
            box = box.replaced(o, hi=min(box.hi[o], claims.cap))
        if claims.infeasible:
            raise Refused(f"box {name} is still open, so a solution is not excluded", "proof")
        if o is not None and claims.eps_lo is not None and box.lo[o] < claims.eps_lo:
            raise Refused(f"box {name} is still open below eps_lo", "proof")
        if claims.enclosure is not None and not Box(*claims.enclosure).holds(box.lo, box.hi):
            raise Refused(f"box {name} reaches out of the enclosure", "proof")
