"""Checks a certificate: forms every polynomial again in exact arithmetic, and accepts what is proved.

docs/certificate-format.md is the specification; Refused says what is wrong, and in which line.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .campaign import ExactCampaign, beside
from .claims import Accepted, Claims, Point
from .leg import EXTRA, leg_problem
from .polynomial import READINGS, TooLarge
from .problem import SIDES, Box, Given, Problem, Stated, Unknowns
from .rule import Row, Rule, Weights
from .strict import WORK, Lines, opened

FORMAT = "cpcal-certificate/4"
_MOST_UNKNOWNS = 1000
_MOST_CONSTRAINTS = 100_000
_MOST_TERMS = 400_000  # of all constraints
_HIGHEST = 8  # degree
_MOST_OPEN = 100_000  # boxes
_MOST_BOUNDS = 2_000_000  # of all open boxes


def check(certificate: Path, campaign: Path | ExactCampaign | None = None, *, work: int = WORK) -> Accepted:
    """Check a certificate, one about a leg against the campaign.json (default: the one beside it).

    Raises Refused, or Unusable where a file cannot be read. `work`: multiplications that it may cost.
    """
    with opened(certificate) as stream:
        lines = Lines(stream, work)
        try:
            return _Check(lines, certificate, campaign).run()
        except TooLarge as error:
            raise lines.refused(str(error)) from None
        except (OverflowError, MemoryError, RecursionError):
            raise lines.refused("the values are too large, or nested too deeply") from None


@dataclass
class _Check:
    """One pass over the lines; holds the problem, the open boxes and nothing else that grows."""

    lines: Lines
    certificate: Path
    campaign: Path | ExactCampaign | None
    steps: int = 0
    next_name: int = 1
    open: dict[int, Box] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)

    def run(self) -> Accepted:
        lines, header = self.lines, self.lines.following("the header")
        if header.get("format") != FORMAT:
            raise lines.refused(f"the format is not {FORMAT}: certify again with this version of cpcal")
        self.problem = self._leg(header) if "campaign" in header else self._stated(header)
        self.objective, self.size = self.problem.objective, len(self.problem.unknowns)
        self.chosen = frozenset(self.problem.chosen)
        self.open[0] = self.root
        self.claims = self._claims(lines.following("the claims"))
        for step in lines:
            self._step(step)
        for name, box in self.open.items():
            self._concluded(name, box)
        p, about = self.problem, header.get("about", "")
        return Accepted(
            leg=header.get("leg"), model=p.model, about=about, campaign=header.get("campaign"), unknowns=p.unknowns,
            objective=p.objective, count=p.count, chosen=p.chosen, lo=self.root.lo, hi=self.root.hi,
            claims=self.claims, used=frozenset(self.used), steps=self.steps,
        )  # fmt: skip

    # the problem --------------------------------------------------------------------------------------------------

    def _leg(self, value: dict[str, Any]) -> Problem:
        lines = self.lines
        lines.keys(value, "format", "campaign", "leg", "model", "measurements", "only", "lo", "hi")
        model = value["model"]
        if not isinstance(model, str) or model not in EXTRA:
            raise lines.refused(f"the model is none of {', '.join(EXTRA)}")
        campaign = self.campaign
        if campaign is None:
            campaign = beside(self.certificate, value["campaign"])
        elif isinstance(campaign, Path):
            campaign = ExactCampaign(campaign)
        if value["campaign"] != campaign.sha256:
            raise lines.refused("the campaign is another one: its SHA-256 differs")
        if value["measurements"] != len(campaign) or type(value["measurements"]) is not int:
            raise lines.refused(f"the campaign has {len(campaign)} measurements")
        only = None if value["only"] is None else lines.integers(value["only"], len(campaign))
        if only == ():
            raise lines.refused("a certificate of no measurements says nothing")
        problem = leg_problem(campaign.of(lines.integer(value["leg"], campaign.legs + 1, 1)), model, only)
        self._root(value, len(problem.unknowns))
        if self.root.lo[-1] < 0:
            raise lines.refused("eps is negative in the box of the problem")
        return problem

    def _stated(self, value: dict[str, Any]) -> Problem:
        lines = self.lines
        lines.keys(value, "format", "about", "unknowns", "objective", "constraints", "lo", "hi")
        names = tuple(lines.list(value["unknowns"]))
        if not isinstance(value["about"], str) or any(not isinstance(name, str) for name in names):
            raise lines.refused("what it is about is a text, and so is the name of an unknown")
        if not 0 < len(names) <= _MOST_UNKNOWNS or len(set(names)) < len(names):
            raise lines.refused(f"there must be from 1 to {_MOST_UNKNOWNS} unknowns, with names of their own")
        objective = None if value["objective"] is None else lines.integer(value["objective"], len(names))
        count = lines.integer(value["constraints"], _MOST_CONSTRAINTS + 1)
        self._root(value, len(names))
        items, self.terms = [], 0
        for _ in range(count):
            given = lines.keys(lines.following("all constraints"), "name", "root", "body", "at_least", "at_most")
            name, root, *parts = given
            if not isinstance(name, str) or type(root) is not bool or parts[0] is None:
                raise lines.refused("a constraint has a name and a body, and root is true or false")
            body, low, high = (None if p is None else self._polynomial(p, len(names)) for p in parts)
            items.append(Stated(name, root, body or (), low, high))
        return Problem(names, objective, count, tuple(range(count)), SIDES, items.__getitem__)

    def _polynomial(self, value: Any, unknowns: int) -> Given:
        lines, out = self.lines, dict[tuple[int, ...], F]()
        self.terms += len(lines.list(value))
        if self.terms > _MOST_TERMS:
            raise lines.refused(f"the constraints have more than {_MOST_TERMS} terms")
        for entry in value:
            monomial, coefficient = lines.list(entry, 2)
            key = tuple(lines.integer(i, unknowns) for i in lines.list(monomial))
            if len(key) > _HIGHEST or key != tuple(sorted(key)) or key in out:
                raise lines.refused(f"monomials are sorted, of degree at most {_HIGHEST}, and stand once each")
            out[key] = lines.number(coefficient)
        return tuple(out.items())

    def _root(self, value: dict[str, Any], size: int) -> None:
        self.root = Box(self.lines.vector(value["lo"], size), self.lines.vector(value["hi"], size))
        if any(a > b for a, b in zip(self.root.lo, self.root.hi, strict=True)):
            raise self.lines.refused("the box of the problem is empty")

    # the claims ---------------------------------------------------------------------------------------------------

    def _claims(self, value: dict[str, Any]) -> Claims:
        lines, n, o = self.lines, self.size, self.objective
        names = ("cap", "infeasible", "epsilon", "enclosure", "point")
        cap, infeasible, epsilon, enclosure, point = lines.keys(value, *names)
        if type(infeasible) is not bool or (epsilon is not None and o is None):
            raise lines.refused("infeasible is true or false, and a problem without an objective has no epsilon")
        limit = self._cap(cap)
        at = None if point is None else self._point(point)
        lo = hi = hull = None
        if epsilon is not None and o is not None and limit is not None:
            low, high = lines.keys(epsilon, "lo", "hi")
            lo, hi = lines.number(low), None if high is None else lines.number(high)
            if not self.root.lo[o] <= lo <= limit or (self.problem.model and self.root.lo[o] != 0):
                raise lines.refused("eps_lo lies between the least eps of the problem, which is 0 for a leg, and cap")
            if hi is not None and not (lo <= hi and at is not None and self._attains(at, o, hi)):
                raise lines.refused("eps_hi is not proved: no point of the box with it satisfies every measurement")
        if enclosure is not None:
            low, high = lines.keys(enclosure, "lo", "hi")
            hull = lines.vector(low, n), lines.vector(high, n)
        return Claims(limit, infeasible, lo, hi, hull, at)

    def _cap(self, value: Any) -> F | None:
        """A bound of the objective, or null where there is none."""
        if self.objective is None:
            if value is not None:
                raise self.lines.refused("a problem without an objective has no cap")
            return None
        cap = self.lines.number(value)
        if not self.root.lo[self.objective] <= cap <= self.root.hi[self.objective]:
            raise self.lines.refused("the cap is not an eps of the problem")
        return cap

    def _point(self, value: Any) -> Point:
        lines, p = self.lines, self.problem
        at, holds, readings, fails = lines.keys(value, "at", "holds", "readings", "fails")
        point = lines.vector(at, self.size)
        good = p.chosen if holds == "all" else lines.integers(holds, p.count)
        signs: list[Any] = [None] * len(good) if readings is None else lines.list(readings, len(good))
        bad = [self._row(entry) for entry in lines.list(fails)]
        if not {*good, *(k for _, k, _ in bad)} <= self.chosen:
            raise lines.refused("the point is judged by a measurement that is left out")
        x = Unknowns(Box(point, point), lines.spend)
        for k, given in zip(good, signs, strict=True):
            if not p.holds(x, k, self._signs(given, k)):
                raise lines.refused(f"it is not proved that the point satisfies measurement {k}")
        for row in bad:
            if not p.fails(x, *row):
                raise lines.refused(f"it is not proved that the point fails at measurement {row[1]}")
        return Point(point, good, tuple(k for _, k, _ in bad))

    def _attains(self, point: Point, o: int, value: F) -> bool:
        inside = all(a <= v <= b for a, v, b in zip(self.root.lo, point.at, self.root.hi, strict=True))
        return inside and point.holds == self.problem.chosen and point.at[o] == value

    # the steps ----------------------------------------------------------------------------------------------------

    def _step(self, step: dict[str, Any]) -> None:
        lines = self.lines
        self.steps += 1
        lines.spend(self.size)
        if "pass" in step:
            name, cap, rows, bounds = lines.keys(step, "pass", "cap", "rows", "bounds")
            table = self._table(rows)
            proofs = [self._bound(entry, len(table)) for entry in lines.list(bounds)]
            box = self._capped(name, cap)
            if box is not None:
                self._pass(name, box, table, proofs)
        elif "exclude" in step:
            name, cap, rows, given = lines.keys(step, "exclude", "cap", "rows", "weights")
            table = self._table(rows)
            weights, box = self._weights(given, len(table)), self._capped(name, cap)
            if box is not None and not Rule(self.problem, box, table, lines.spend).excludes(weights):
                raise lines.refused("the weights do not exclude the box")
            self.open.pop(name, None)
        elif "split" in step:
            self._split(*lines.keys(step, "split", "unknown", "at", "into"))
        else:
            raise lines.refused("is neither a pass, nor an exclusion, nor a split")

    def _table(self, value: Any) -> list[Row]:
        """The rows of a step."""
        rows = [self._row(entry) for entry in self.lines.list(value)]
        self.used |= {k for _, k, _ in rows}
        if not self.used <= self.chosen:
            raise self.lines.refused("a measurement that is left out has a weight")
        return rows

    def _row(self, entry: Any) -> Row:
        """A row with its reference reading; signs that are left out are all 0."""
        side, k, *signs = self.lines.list(entry, 2, 3)
        if side not in self.problem.sides:
            raise self.lines.refused(f"{str(side)[:40]!a} is no side of a measurement")
        number = self.lines.integer(k, self.problem.count)
        return side, number, self._signs(signs[0] if signs else None, number)

    def _signs(self, given: Any, k: int) -> str:
        count = READINGS if self.problem.model else 0
        return "0" * count if given is None else self.lines.signs(given, count)

    def _bound(self, entry: Any, rows: int) -> tuple[int, str, F, Weights]:
        unknown, side, number, weights = self.lines.list(entry, 4)
        if side not in ("lo", "hi"):
            raise self.lines.refused("a bound is on the side lo or hi")
        i = self.lines.integer(unknown, self.size)
        return i, side, self.lines.number(number), self._weights(weights, rows)

    def _weights(self, value: Any, rows: int) -> Weights:
        lines, n, most = self.lines, self.size, 1 << 60
        of_rows, products, tangents, powers = lines.keys(value, "rows", "products", "tangents", "exponents")
        r, p, t = (lines.integer(e, 1000, -1000) for e in lines.list(powers, 3))
        found = []
        for row, w in (lines.list(entry, 2) for entry in lines.list(of_rows)):
            found.append((lines.integer(row, rows), lines.integer(w, most)))
        pairs = []
        for i, j, a, b, w in (lines.list(entry, 5) for entry in lines.list(products)):
            signs = lines.sign(a), lines.sign(b)
            pairs.append((lines.integer(i, n), lines.integer(j, n), *signs, lines.integer(w, most)))
        squares = []
        for i, touch, w in (lines.list(entry, 3) for entry in lines.list(tangents)):
            squares.append((lines.integer(i, n), lines.number(touch), lines.integer(w, most)))
        return Weights(tuple(found), tuple(pairs), tuple(squares), (r, p, t))

    def _box(self, name: Any) -> Box:
        if type(name) is not int or name not in self.open:
            raise self.lines.refused(f"no box {str(name)[:20]!a} is open")
        return self.open[name]

    def _capped(self, name: Any, cap: Any) -> Box | None:
        """The open box with its objective cut at `cap`; None, and closed, when that leaves nothing."""
        box, value, o = self._box(name), self._cap(cap), self.objective
        if o is None or value is None or self.claims.cap is None:
            return box
        if value < self.claims.cap:
            raise self.lines.refused("a cap is below that of the claims")
        return self._kept(name, box.replaced(o, hi=min(box.hi[o], value)), [o])

    def _kept(self, name: int, box: Box, changed: Iterable[int]) -> Box | None:
        """The box in the place of the old one, or None, and closed, if a changed bound makes it empty."""
        if any(box.lo[i] > box.hi[i] for i in changed):
            del self.open[name]
            return None
        self.open[name] = box
        return box

    def _pass(self, name: int, box: Box, table: list[Row], proofs: list[tuple[int, str, F, Weights]]) -> None:
        rule, lo, hi = Rule(self.problem, box, table, self.lines.spend), list(box.lo), list(box.hi)
        for i, side, bound, weights in proofs:
            proved = rule.bound(i, side, weights)
            if proved < bound if side == "lo" else proved > bound:
                raise self.lines.refused(f"the weights prove less than the bound on unknown {i}")
            if side == "lo":
                lo[i] = max(lo[i], bound)
            else:
                hi[i] = min(hi[i], bound)
        self._kept(name, Box(tuple(lo), tuple(hi)), {i for i, *_ in proofs})

    def _split(self, name: Any, unknown: Any, at: Any, into: Any) -> None:
        lines, box = self.lines, self._box(name)
        i, cut, names = lines.integer(unknown, self.size), lines.number(at), lines.list(into, 2)
        if names != [self.next_name, self.next_name + 1] or any(type(n) is not int for n in names):
            raise lines.refused(f"new boxes are named in order; the next is {self.next_name}")
        if not box.lo[i] <= cut <= box.hi[i]:
            raise lines.refused("the cut is outside the box")
        del self.open[name]
        if len(self.open) + 2 > min(_MOST_OPEN, _MOST_BOUNDS // self.size):
            raise lines.refused("too many boxes are open")
        self.next_name += 2
        self.open[names[0]], self.open[names[1]] = box.replaced(i, hi=cut), box.replaced(i, lo=cut)

    # the conclusions ----------------------------------------------------------------------------------------------

    def _concluded(self, name: int, box: Box) -> None:
        """Whether the claims leave room for the solutions in an open box."""
        claims, o = self.claims, self.objective
        if o is not None and claims.cap is not None:
            if box.lo[o] > claims.cap:
                return
            box = box.replaced(o, hi=min(box.hi[o], claims.cap))
        if claims.infeasible:
            raise self.lines.refused(f"box {name} is still open, so a solution is not excluded")
        if o is not None and claims.eps_lo is not None and box.lo[o] < claims.eps_lo:
            raise self.lines.refused(f"box {name} is still open below eps_lo")
        if claims.enclosure is not None:
            low, high = claims.enclosure
            if any(low[i] > box.lo[i] or high[i] < box.hi[i] for i in range(self.size)):
                raise self.lines.refused(f"box {name} reaches out of the enclosure")
