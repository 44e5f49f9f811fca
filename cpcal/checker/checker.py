"""The checker: reads a certificate and what it speaks of, and accepts what is proved. Standard library only.

It trusts nothing that the solver did: every polynomial is formed again from the campaign's numbers in exact
rational arithmetic. docs/certificate-format.md is the specification; `Refused` says what is wrong, and in which line.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from cpcal.checker.campaign import ExactCampaign
from cpcal.checker.claims import Accepted, Claims, Point, fractions, plain
from cpcal.checker.constraints import read_constraints, read_unknowns
from cpcal.checker.leg import Leg
from cpcal.checker.lines import Lines, Rational
from cpcal.checker.models import EXTRA, Model
from cpcal.checker.polynomial import ExactBox
from cpcal.checker.refusal import Refused
from cpcal.checker.rule import Problem, Rule, Weights

FORMAT = "cpcal-certificate/3"
_MOST_OPEN = 100_000  # boxes, so that memory stays bounded
_MOST_STEPS = 10_000_000  # so that an endless file ends


def check(certificate: Path, campaign: Path | None = None, *, rational: Rational = F) -> Accepted:
    """Check a certificate, one about a leg against the campaign folder that it speaks of. Raises Refused.

    `rational` makes the exact numbers, such as flint.fmpq for speed.
    """
    try:
        with certificate.open("rb") as stream:
            return _Checker(Lines(stream, rational), campaign, rational).run()
    except OSError as error:
        raise Refused(0, f"{certificate} cannot be read: {error}") from None


@dataclass
class _Checker:
    """One pass over the lines; holds the problem, the open boxes and nothing else that grows."""

    lines: Lines
    folder: Path | None
    rational: Rational
    steps: int = 0
    next_name: int = 1
    open: dict[int, ExactBox] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)

    def run(self) -> Accepted:
        lines = self.lines
        header = lines.following("the header")
        self.problem, self.leg = self._problem(header)
        self.size, self.objective = len(self.problem.unknowns), self.problem.objective
        self.open[0] = self.root
        self.claims = self._claims(lines.following("the claims"))
        for step in lines:
            self._step(step)
        self._conclude()
        p, lo, hi = self.problem, fractions(self.root.lo), fractions(self.root.hi)
        used, claims = frozenset(self.used), plain(self.claims)
        model = p.model.name if isinstance(p, Leg) else None
        return Accepted(self.leg, model, p.unknowns, p.objective, p.count, p.chosen, lo, hi, claims, used, self.steps)

    # the problem and the claims -------------------------------------------------------------------------------

    def _problem(self, value: dict[str, Any]) -> tuple[Problem, int | None]:
        lines = self.lines
        if value.get("format") != FORMAT:
            raise lines.refused(f"the format is not {FORMAT}")
        if "campaign" not in value:
            lines.keys(value, "format", "about", "unknowns", "objective", "constraints", "lo", "hi")
            if not isinstance(value["about"], str):
                raise lines.refused("what it is about is a text")
            names = read_unknowns(lines, value["unknowns"])
            objective = None if value["objective"] is None else lines.integer(value["objective"], len(names))
            count = lines.integer(value["constraints"], 1 << 60)
            self.root = self._box_of(value, len(names))
            return read_constraints(lines, names, objective, count), None
        lines.keys(value, "format", "campaign", "leg", "model", "measurements", "only", "lo", "hi")
        leg, name = lines.integer(value["leg"], 1000), value["model"]
        if leg == 0:
            raise lines.refused("legs are counted from 1")
        if not isinstance(name, str) or name not in EXTRA:
            raise lines.refused(f"the model is none of {', '.join(EXTRA)}")
        if self.folder is None:
            raise Refused(0, "the campaign that it speaks of is needed")
        campaign = ExactCampaign(self.folder, leg, self.rational)
        if value["campaign"] != campaign.sha256:
            raise lines.refused("the campaign is another one: its SHA-256 differs")
        if value["measurements"] != len(campaign) or type(value["measurements"]) is not int:
            raise lines.refused(f"the campaign has {len(campaign)} measurements")
        only = None if value["only"] is None else lines.integers(value["only"], len(campaign))
        if only == ():
            raise lines.refused("a certificate of no measurements says nothing")
        model = Model(name)
        self.root = self._box_of(value, len(model.unknowns))
        if self.root.lo[-1] < 0:
            raise lines.refused("eps is negative in the box of the problem")
        return Leg(campaign, model, only), leg

    def _box_of(self, value: dict[str, Any], size: int) -> ExactBox:
        box = ExactBox(self.lines.vector(value["lo"], size), self.lines.vector(value["hi"], size))
        if any(a > b for a, b in zip(box.lo, box.hi, strict=True)):
            raise self.lines.refused("the box of the problem is empty")
        return box

    def _claims(self, value: dict[str, Any]) -> Claims:
        lines, n = self.lines, self.size
        names = ("cap", "infeasible", "epsilon", "enclosure", "point")
        cap, infeasible, epsilon, enclosure, point = lines.keys(value, *names)
        if type(infeasible) is not bool or (epsilon is not None and self.objective is None):
            raise lines.refused("infeasible is true or false, and a problem without an objective has no epsilon")
        limit = self._cap(cap)
        at = None if point is None else self._point(point)
        lo = hi = hull = None
        if epsilon is not None and self.objective is not None and limit is not None:
            low, high = lines.keys(epsilon, "lo", "hi")
            lo, hi = lines.number(low), None if high is None else lines.number(high)
            if not self.root.lo[self.objective] <= lo <= limit or (self.leg is not None and self.root.lo[-1] != 0):
                raise lines.refused("eps_lo lies between the least eps of the problem, which is 0 for a leg, and cap")
            if hi is not None and not (lo <= hi and at is not None and self._attains(at, hi)):
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
            raise self.lines.refused("the cap of the claims is not an eps of the problem")
        return cap

    def _point(self, value: Any) -> Point:
        lines = self.lines
        at, holds, fails = lines.keys(value, "at", "holds", "fails")
        chosen, x = self.problem.chosen, lines.vector(at, self.size)
        good = chosen if holds == "all" else lines.integers(holds, self.problem.count)
        bad = lines.integers(fails, self.problem.count)
        if not set(good) | set(bad) <= set(chosen):
            raise lines.refused("the point is judged by a measurement that is left out")
        for k in good:
            if not self.problem.holds(k, x):
                raise lines.refused(f"it is not proved that the point satisfies measurement {k}")
        for k in bad:
            if not self.problem.fails(k, x):
                raise lines.refused(f"it is not proved that the point fails at measurement {k}")
        return Point(x, good, bad)

    def _attains(self, point: Point, value: F) -> bool:
        inside = all(a <= v <= b for a, v, b in zip(self.root.lo, point.at, self.root.hi, strict=True))
        assert self.objective is not None
        return inside and point.holds == self.problem.chosen and point.at[self.objective] == value

    # the steps ----------------------------------------------------------------------------------------------------

    def _step(self, step: dict[str, Any]) -> None:
        lines = self.lines
        self.steps += 1
        if self.steps > _MOST_STEPS:
            raise lines.refused(f"there are more than {_MOST_STEPS} steps")
        if "pass" in step:
            name, cap, bounds = lines.keys(step, "pass", "cap", "bounds")
            box = self._capped(name, cap)
            if box is not None:
                self._pass(name, box, lines.list(bounds))
        elif "exclude" in step:
            name, cap, weights = lines.keys(step, "exclude", "cap", "weights")
            box = self._capped(name, cap)
            if box is not None and not Rule(self.problem, box).excludes(self._weights(weights)):
                raise lines.refused("the weights do not exclude the box")
            self.open.pop(name, None)
        elif "split" in step:
            self._split(*lines.keys(step, "split", "unknown", "at", "into"))
        else:
            raise lines.refused("is neither a pass, nor an exclusion, nor a split")

    def _box(self, name: Any) -> ExactBox:
        if type(name) is not int or name not in self.open:
            raise self.lines.refused(f"no box {str(name)[:20]!a} is open")
        return self.open[name]

    def _capped(self, name: Any, cap: Any) -> ExactBox | None:
        """The open box with its objective cut at `cap`; None, and closed, when that leaves nothing."""
        box, value, o = self._box(name), self._cap(cap), self.objective
        if o is None or value is None or self.claims.cap is None:
            return box
        if value < self.claims.cap:
            raise self.lines.refused("a cap is below that of the claims")
        box = ExactBox(box.lo, (*box.hi[:o], min(box.hi[o], value), *box.hi[o + 1 :]))
        return self._kept(name, box)

    def _kept(self, name: int, box: ExactBox) -> ExactBox | None:
        if any(a > b for a, b in zip(box.lo, box.hi, strict=True)):
            del self.open[name]
            return None
        self.open[name] = box
        return box

    def _pass(self, name: int, box: ExactBox, bounds: list[Any]) -> None:
        lines, rule, lo, hi = self.lines, Rule(self.problem, box), list(box.lo), list(box.hi)
        for entry in bounds:
            unknown, side, number, weights = lines.list(entry, 4)
            i, bound = lines.integer(unknown, self.size), lines.number(number)
            if side not in ("lo", "hi"):
                raise lines.refused("the side of a bound is lo or hi")
            proved = rule.bound(i, side, self._weights(weights))
            if (bound > proved) if side == "lo" else (bound < proved):
                raise lines.refused(f"the weights prove less than the bound on unknown {i}")
            if side == "lo":
                lo[i] = max(lo[i], bound)
            else:
                hi[i] = min(hi[i], bound)
        self._kept(name, ExactBox(tuple(lo), tuple(hi)))

    def _weights(self, value: Any) -> Weights:
        lines, n = self.lines, self.size
        rows, products, tangents, exponents = lines.keys(value, "rows", "products", "tangents", "exponents")
        r, p, t = (lines.integer(e, 1000, -1000) for e in lines.list(exponents, 3))
        of_rows, of_pairs, of_squares = [], [], []
        for entry in lines.list(rows):
            side, k, weight = lines.list(entry, 3)
            if side not in self.problem.sides:
                raise lines.refused(f"{str(side)[:40]!a} is no side of a measurement")
            of_rows.append((side, lines.integer(k, self.problem.count), lines.weight(weight)))
        for entry in lines.list(products):
            i, j, a, b, weight = lines.list(entry, 5)
            pair = lines.integer(i, n), lines.integer(j, n), lines.sign(a), lines.sign(b)
            of_pairs.append((*pair, lines.weight(weight)))
        for entry in lines.list(tangents):
            i, touch, weight = lines.list(entry, 3)
            of_squares.append((lines.integer(i, n), lines.number(touch), lines.weight(weight)))
        self.used |= {k for _, k, _ in of_rows}
        if not self.used <= set(self.problem.chosen):
            raise lines.refused("a measurement that is left out has a weight")
        return Weights(tuple(of_rows), tuple(of_pairs), tuple(of_squares), (r, p, t))

    def _split(self, name: Any, unknown: Any, at: Any, into: Any) -> None:
        lines, box = self.lines, self._box(name)
        i, cut, names = lines.integer(unknown, self.size), lines.number(at), lines.list(into, 2)
        if names != [self.next_name, self.next_name + 1] or any(type(n) is not int for n in names):
            raise lines.refused(f"new boxes are named in order; the next is {self.next_name}")
        if not box.lo[i] <= cut <= box.hi[i]:
            raise lines.refused("the cut is outside the box")
        del self.open[name]
        if len(self.open) + 2 > _MOST_OPEN:
            raise lines.refused("too many boxes are open")
        self.next_name += 2
        self.open[names[0]] = ExactBox(box.lo, (*box.hi[:i], cut, *box.hi[i + 1 :]))
        self.open[names[1]] = ExactBox((*box.lo[:i], cut, *box.lo[i + 1 :]), box.hi)

    # the conclusions ----------------------------------------------------------------------------------------------

    def _conclude(self) -> None:
        claims, o = self.claims, self.objective
        for name, box in self.open.items():
            lo, hi = box.lo, box.hi
            if o is not None and claims.cap is not None:
                if lo[o] > claims.cap:
                    continue
                hi = (*hi[:o], min(hi[o], claims.cap), *hi[o + 1 :])
            if claims.infeasible:
                raise self.lines.refused(f"box {name} is still open, so a solution is not excluded")
            if o is not None and claims.eps_lo is not None and lo[o] < claims.eps_lo:
                raise self.lines.refused(f"box {name} is still open below eps_lo")
            if claims.enclosure is not None:
                low, high = claims.enclosure
                if any(low[i] > lo[i] or high[i] < hi[i] for i in range(self.size)):
                    raise self.lines.refused(f"box {name} reaches out of the enclosure")
