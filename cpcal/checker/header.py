"""The first lines of a certificate: the problem that it speaks of, and its box."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction as F
from math import prod
from pathlib import Path
from typing import Any

from .exact_campaign import ExactCampaign, beside
from .exact_polynomial import Polynomial, Spend, constant, unknown
from .files import Lines
from .leg import EXTRA, check_model, leg_problem
from .problem import Box, Constraint, Problem
from .program import dyadics
from .readers import anything, ascending, choice, dyadic, entry, many, maybe, record, text, whole
from .refusal import Refused

FORMAT = "cpcal-certificate/4"
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
    header: dict[str, Any], lines: Lines, certificate: Path, campaign: Path | ExactCampaign | None
) -> tuple[Problem, Box]:
    """The problem and its box; of a leg by its campaign, else by the lines that follow."""
    if header.get("format") != FORMAT:
        raise Refused(f"the format is not {FORMAT}: certify again with this version of cpcal")
    return _leg(header, lines, certificate, campaign) if "campaign" in header else _stated(header, lines)


def _leg(
    header: dict[str, Any], lines: Lines, certificate: Path, given: Path | ExactCampaign | None
) -> tuple[Problem, Box]:
    forms: tuple[Given, ...] = ()
    if "forms" in header:
        header = dict(header)
        forms = _FORMS(header.pop("forms"))
    _, digest, leg, model, count, only, lo, hi = _LEG(header)
    campaign = beside(certificate, digest) if given is None else given
    if isinstance(campaign, Path):
        campaign = ExactCampaign(campaign)
    if digest != campaign.sha256:
        raise Refused("the campaign is another one: its SHA-256 differs", "campaign")
    if count != len(campaign) or leg > campaign.legs or (only or (0,))[-1] >= count:
        raise Refused(f"the campaign has {campaign.legs} legs and {len(campaign)} measurements")
    if only == ():
        raise Refused("a certificate of no measurements says nothing")
    if len(forms) > _MOST_FORMS or any(v >= 7 for form in forms for m, _ in form for v in m):
        raise Refused(f"there are at most {_MOST_FORMS} forms, in the first seven unknowns")
    stated = [polynomial(form, lines.spend) for form in forms]
    problem = leg_problem(lambda k: campaign.measurement(k, leg), count, model, only, stated)
    root = _box(lo, hi, len(problem.unknowns) - len(forms))
    if root.lo[-1] < 0:
        raise Refused("eps is negative in the box of the problem")
    return replace(problem, forms=forms), with_forms(root, forms)


def with_forms(root: Box, forms: Sequence[Given]) -> Box:
    """With a power of two for each form that none of its values on the box is above."""
    most, ends = dyadics([max(-a, b) for a, b in zip(root.lo, root.hi, strict=True)]), list[F]()
    for form in forms:
        by, degree = dyadics([abs(c) for _, c in form]), max((len(m) for m, _ in form), default=0)
        sizes = (
            c * prod(most.values[v] for v in m) << most.power * (degree - len(m))
            for c, (m, _) in zip(by.values, form, strict=True)
        )
        ends.append(F(1 << (sum(sizes) >> by.power + most.power * degree).bit_length()))
    return Box((*root.lo, *(-end for end in ends)), (*root.hi, *ends))


def _stated(header: dict[str, Any], lines: Lines) -> tuple[Problem, Box]:
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


def _box(lo: tuple[F, ...], hi: tuple[F, ...], size: int) -> Box:
    if {len(lo), len(hi)} != {size}:
        raise Refused(f"a list of {size} is needed here")
    if any(a > b for a, b in zip(lo, hi, strict=True)):
        raise Refused("the box of the problem is empty")
    return Box(lo, hi)
