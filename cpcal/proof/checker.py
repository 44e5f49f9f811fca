"""The checker: reads a certificate and a campaign, and accepts what is proved. Standard library only.

It trusts nothing that the solver did: every polynomial is formed again from the campaign's numbers in exact
rational arithmetic. docs/certificate-format.md is the specification; `Refused` says what is wrong, and in which line.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any, BinaryIO

from cpcal.proof.bounds import Bounder, ExactBox, Weights
from cpcal.proof.campaign import ExactCampaign
from cpcal.proof.measurement import EPS, OFFSET, Measurement, arm_matrix
from cpcal.proof.refusal import Refused

FORMAT = "cpcal-certificate/1"
_LONGEST_LINE = 4 << 20
_MOST_OPEN = 100_000  # boxes, so that memory stays bounded
_MOST_STEPS = 10_000_000  # so that an endless file ends
_HEX = re.compile(r"[-+]?0x[01](\.[0-9a-f]{1,13})?p[-+]?[0-9]{1,4}")


@dataclass(frozen=True)
class Accepted:
    """What a certificate proves: claims in exact numbers, and how much work that was."""

    leg: int
    measurements: int
    lo: tuple[F, ...]
    hi: tuple[F, ...]
    eps_lo: F
    eps_hi: F | None
    enclosure: tuple[tuple[F, ...], tuple[F, ...]] | None
    steps: int


def check(certificate: Path, campaign: Path) -> Accepted:
    """Check a certificate against the campaign folder that it speaks of. Raises Refused."""
    try:
        with certificate.open("rb") as stream:
            return _Checker(_objects(stream), campaign).run()
    except OSError as error:
        raise Refused(0, f"{certificate} cannot be read: {error}") from None


def _objects(stream: BinaryIO) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lines as JSON objects, one at a time, none longer than the limit."""
    number = 0
    while line := stream.readline(_LONGEST_LINE + 1):
        number += 1
        if len(line) > _LONGEST_LINE:
            raise Refused(number, "the line is longer than 4 MiB")
        try:
            value = json.loads(line.decode("utf-8"), object_pairs_hook=_unique, parse_constant=_no_constant)
        except (ValueError, RecursionError) as error:
            raise Refused(number, f"is not JSON of this format: {str(error)[:100]}") from None
        if not isinstance(value, dict):
            raise Refused(number, "is not an object")
        yield number, value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def _no_constant(text: str) -> Any:
    raise ValueError(f"{text} is no number here")


class _Checker:
    """One pass over the lines; holds the open boxes and nothing else that grows."""

    def __init__(self, lines: Iterator[tuple[int, dict[str, Any]]], campaign: Path) -> None:
        self._lines, self._folder = lines, campaign
        self._line, self._steps, self._next_name = 0, 0, 1
        self._open: dict[int, ExactBox] = {}
        self._known: dict[int, Measurement] = {}

    def run(self) -> Accepted:
        self._header(self._following("the header"))
        self._claims(self._following("the claims"))
        witnessed = False
        for self._line, step in self._lines:  # noqa: B020 - the line is what a refusal names
            if witnessed:
                raise self._refused("nothing may follow the witness")
            if "point" in step:
                self._witness(step)
                witnessed = True
            else:
                self._step(step)
        if self._eps_hi is not None and not witnessed:
            raise self._refused("eps_hi is claimed, but the witness is missing")
        self._conclude()
        root = self._root
        return Accepted(
            self._leg, self._count, root.lo[:7], root.hi[:7], self._eps_lo, self._eps_hi, self._enclosure, self._steps
        )

    # reading ------------------------------------------------------------------------------------------------

    def _refused(self, reason: str) -> Refused:
        return Refused(self._line, reason)

    def _following(self, what: str) -> dict[str, Any]:
        self._line, value = next(self._lines, (self._line + 1, {}))
        if not value:
            raise self._refused(f"the file ends before {what}, or it is empty")
        return value

    def _keys(self, value: Any, *names: str) -> list[Any]:
        if not isinstance(value, dict) or set(value) != set(names):
            raise self._refused(f"an object with the keys {', '.join(names)} is needed here")
        return [value[name] for name in names]

    def _number(self, value: Any) -> F:
        if not isinstance(value, str) or len(value) > 40 or not _HEX.fullmatch(value):
            raise self._refused(f"{str(value)[:40]!a} is not a number of this format")
        try:
            number = float.fromhex(value)
        except OverflowError:
            number = math.inf
        if math.isinf(number):
            raise self._refused(f"{value!r} is too large")
        if abs(number) < sys.float_info.min:  # only here does fromhex round
            digits, exponent = value.split("p")
            if F(float.fromhex(digits + "p0")) * F(2) ** int(exponent) != F(number):
                raise self._refused(f"{value!r} is no float64")
        return F(number)

    def _weight(self, value: Any) -> F:
        weight = self._number(value)
        if weight < 0:
            raise self._refused("a weight is negative")
        return weight

    def _integer(self, value: Any, below: int) -> int:
        if type(value) is not int or not 0 <= value < below:
            raise self._refused(f"{str(value)[:40]!a} is no whole number from 0 to {below - 1}")
        return value

    def _list(self, value: Any, length: int | None = None) -> list[Any]:
        if not isinstance(value, list) or (length is not None and len(value) != length):
            raise self._refused("a list" + (f" of {length}" if length is not None else "") + " is needed here")
        return value

    def _vector(self, value: Any, length: int) -> tuple[F, ...]:
        return tuple(self._number(v) for v in self._list(value, length))

    def _sign(self, value: Any) -> F:
        if value not in (1, -1) or type(value) is not int:
            raise self._refused("the sign in a product of bounds is 1 or -1")
        return F(value)

    def _weights(self, value: Any) -> Weights:
        rows, products, tangents = self._keys(value, "rows", "products", "tangents")
        side_weights = []
        for entry in self._list(rows):
            side, k, weight = self._list(entry, 3)
            if side not in ("upper", "lower", "length"):
                raise self._refused(f"{str(side)[:40]!a} is no side of a measurement")
            side_weights.append((side, self._integer(k, self._count), self._weight(weight)))
        pairs = []
        for entry in self._list(products):
            i, j, p, q, weight = self._list(entry, 5)
            names = self._integer(i, 8), self._integer(j, 8)
            pairs.append((*names, self._sign(p), self._sign(q), self._weight(weight)))
        squares = []
        for entry in self._list(tangents):
            i, t, weight = self._list(entry, 3)
            squares.append((self._integer(i, 8), self._number(t), self._weight(weight)))
        return Weights(tuple(side_weights), tuple(pairs), tuple(squares))

    # the problem and the claims -------------------------------------------------------------------------------

    def _header(self, value: dict[str, Any]) -> None:
        names = ("format", "campaign", "leg", "measurements", "lo", "hi", "cap")
        form, digest, leg, count, lo, hi, cap = self._keys(value, *names)
        if form != FORMAT:
            raise self._refused(f"the format is not {FORMAT}")
        self._leg = self._integer(leg, 1000)
        if self._leg == 0:
            raise self._refused("legs are counted from 1")
        self._campaign = ExactCampaign(self._folder, self._leg)
        if digest != self._campaign.sha256:
            raise self._refused("the campaign is another one: its SHA-256 differs")
        self._count = len(self._campaign)
        if count != self._count or type(count) is not int:
            raise self._refused(f"the campaign has {self._count} measurements")
        self._root = ExactBox((*self._vector(lo, 7), F(0)), (*self._vector(hi, 7), self._number(cap)))
        if any(a > b for a, b in zip(self._root.lo, self._root.hi, strict=True)):
            raise self._refused("the box of the problem is empty")
        self._open[0] = self._root

    def _claims(self, value: dict[str, Any]) -> None:
        cap, eps_lo, enclosure, eps_hi = self._keys(value, "cap", "eps_lo", "enclosure", "eps_hi")
        self._cap, self._eps_lo = self._number(cap), self._number(eps_lo)
        self._eps_hi = None if eps_hi is None else self._number(eps_hi)
        self._enclosure = None
        if enclosure is not None:
            lo, hi = self._keys(enclosure, "lo", "hi")
            self._enclosure = self._vector(lo, 7), self._vector(hi, 7)
        if not 0 <= self._eps_lo <= self._cap <= self._root.hi[EPS]:
            raise self._refused("0 <= eps_lo <= cap <= cap of the problem does not hold")
        if self._eps_hi is not None and self._eps_hi < self._eps_lo:
            raise self._refused("eps_hi is below eps_lo")

    # the steps ----------------------------------------------------------------------------------------------------

    def _step(self, step: dict[str, Any]) -> None:
        self._steps += 1
        if self._steps > _MOST_STEPS:
            raise self._refused(f"there are more than {_MOST_STEPS} steps")
        if "pass" in step:
            name, cap, bounds = self._keys(step, "pass", "cap", "bounds")
            box = self._capped(name, cap)
            if box is not None:
                self._pass(name, box, self._list(bounds))
        elif "exclude" in step:
            name, cap, weights = self._keys(step, "exclude", "cap", "weights")
            box = self._capped(name, cap)
            if box is not None and not self._bounder(box).excludes(self._weights(weights)):
                raise self._refused("the weights do not exclude the box")
            self._open.pop(name, None)
        elif "split" in step:
            self._split(*self._keys(step, "split", "unknown", "at", "into"))
        else:
            raise self._refused("is neither a pass, nor an exclusion, a split or a witness")

    def _capped(self, name: Any, cap: Any) -> ExactBox | None:
        """The open box with its eps cut at `cap`; None, and closed, when that leaves nothing."""
        if type(name) is not int or name not in self._open:
            raise self._refused(f"no box {str(name)[:20]!a} is open")
        value, box = self._number(cap), self._open[name]
        if value < self._cap:
            raise self._refused("a cap is below that of the claims")
        box = ExactBox(box.lo, (*box.hi[:EPS], min(box.hi[EPS], value)))
        if box.lo[EPS] > box.hi[EPS]:
            del self._open[name]
            return None
        self._open[name] = box
        return box

    def _bounder(self, box: ExactBox) -> Bounder:
        return Bounder(_Measurements(self._campaign, self._known), box)

    def _pass(self, name: int, box: ExactBox, bounds: list[Any]) -> None:
        bounder, lo, hi = self._bounder(box), list(box.lo), list(box.hi)
        for entry in bounds:
            unknown, side, number, weights = self._list(entry, 4)
            i, bound = self._integer(unknown, 8), self._number(number)
            if side not in ("lo", "hi"):
                raise self._refused("the side of a bound is lo or hi")
            proved = bounder.improved(i, side, self._weights(weights))
            if (bound > proved) if side == "lo" else (bound < proved):
                raise self._refused(f"the weights prove less than the bound on unknown {i}")
            if side == "lo":
                lo[i] = max(lo[i], bound)
            else:
                hi[i] = min(hi[i], bound)
        if any(a > b for a, b in zip(lo, hi, strict=True)):
            del self._open[name]
        else:
            self._open[name] = ExactBox(tuple(lo), tuple(hi))

    def _split(self, name: Any, unknown: Any, at: Any, into: Any) -> None:
        if type(name) is not int or name not in self._open:
            raise self._refused(f"no box {str(name)[:20]!a} is open")
        i, cut, names = self._integer(unknown, 8), self._number(at), self._list(into, 2)
        if names != [self._next_name, self._next_name + 1] or any(type(n) is not int for n in names):
            raise self._refused(f"new boxes are named in order; the next is {self._next_name}")
        box = self._open.pop(name)
        if not box.lo[i] <= cut <= box.hi[i]:
            raise self._refused("the cut is outside the box")
        if len(self._open) + 2 > _MOST_OPEN:
            raise self._refused("too many boxes are open")
        self._next_name += 2
        self._open[names[0]] = ExactBox(box.lo, (*box.hi[:i], cut, *box.hi[i + 1 :]))
        self._open[names[1]] = ExactBox((*box.lo[:i], cut, *box.lo[i + 1 :]), box.hi)

    # the conclusions ----------------------------------------------------------------------------------------------

    def _conclude(self) -> None:
        for name, box in self._open.items():
            if box.lo[EPS] > self._cap:
                continue
            if box.lo[EPS] < self._eps_lo:
                raise self._refused(f"box {name} is still open below eps_lo")
            if self._enclosure is not None:
                lo, hi = self._enclosure
                if any(lo[i] > box.lo[i] or hi[i] < box.hi[i] for i in range(7)):
                    raise self._refused(f"box {name} reaches out of the enclosure")

    def _witness(self, value: dict[str, Any]) -> None:
        (point,) = self._keys(value, "point")
        x = self._vector(point, 7)
        if self._eps_hi is None:
            raise self._refused("a witness is given, but eps_hi is not claimed")
        if any(not a <= v <= b for v, a, b in zip(x, self._root.lo[:7], self._root.hi[:7], strict=True)):
            raise self._refused("the witness lies outside the box")
        for k in range(self._count):
            self._attained(k, self._campaign.measurement(k), x, self._eps_hi)

    def _attained(self, k: int, m: Measurement, x: tuple[F, ...], eps: F) -> None:
        """Some reading of measurement k has | ||v|| - (L + e + l) | <= eps, and the leg is longer than eps."""
        shortest, longest = m.length - m.length_radius + x[OFFSET], m.length + m.length_radius + x[OFFSET]
        if shortest < eps:
            raise self._refused(f"the leg is not longer than eps_hi at measurement {k}")
        short, long = extreme_lengths(m, x)
        if short > (longest + eps) ** 2:
            raise self._refused(f"no reading of measurement {k} makes the leg short enough")
        if long < (shortest - eps) ** 2:
            raise self._refused(f"no reading of measurement {k} makes the leg long enough")


class _Measurements(dict[int, Measurement]):
    """Rows of the campaign, read when first used."""

    def __init__(self, campaign: ExactCampaign, known: dict[int, Measurement]) -> None:
        super().__init__()
        self._campaign, self._known = campaign, known

    def __missing__(self, k: int) -> Measurement:
        if k not in self._known:
            self._known[k] = self._campaign.measurement(k)
        return self._known[k]


def leg_vector(m: Measurement, x: tuple[F, ...], d: list[F], s: list[F]) -> list[F]:
    """v = P + d + R(1, s) R(q) b - a, exactly."""
    arm, kappa = arm_matrix(m, tuple(s)), 1 + sum((c * c for c in s), F(0))
    turned = [sum((arm[i][j] * x[3 + j] for j in range(3)), F(0)) / kappa for i in range(3)]
    return [m.position[i] + d[i] + turned[i] - x[i] for i in range(3)]


def extreme_lengths(m: Measurement, x: tuple[F, ...]) -> tuple[F, F]:
    """||v||^2 at the ends of the reading set where it is small and where it is large, by its slopes at the centre."""
    nothing = [F(0)] * 3
    v = leg_vector(m, x, nothing, nothing)
    arm = [v[i] - m.position[i] + x[i] for i in range(3)]
    turn = [arm[(i + 1) % 3] * v[(i + 2) % 3] - arm[(i + 2) % 3] * v[(i + 1) % 3] for i in range(3)]
    lengths = []
    for sign in (-1, 1):
        d = [sign * _sign(v[i]) * m.position_radius[i] for i in range(3)]
        s = [sign * _sign(turn[i]) * m.rotation_radius[i] / 2 for i in range(3)]
        lengths.append(sum((c * c for c in leg_vector(m, x, d, s)), F(0)))
    return lengths[0], lengths[1]


def _sign(value: F) -> int:
    return (value > 0) - (value < 0)
