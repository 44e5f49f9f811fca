"""Checks a run: every number that its result.json states is claimed by an accepted certificate, or not certified."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Any

from .campaign import NAME, ExactCampaign
from .certificate import check
from .claims import Accepted
from .leg import EXTRA, PARAMETERS
from .refusal import Refused, Unusable
from .strict import WORK, opened, parsed, shown

RESULT_NAME = "result.json"
RESULT_FORMAT = "cpcal-result/4"
_LARGEST = 16 << 20  # bytes
_CERTIFICATE = re.compile(r"[A-Za-z0-9_.-]{1,200}\.cert\.jsonl")
_CLOSED = F(1, 10**9)  # a bracket this narrow is closed, whatever the relative gap
_NETWORK = ("a[0]", "a[1]", "a[2]", "b[0]", "b[1]", "b[2]", "l")  # in a certificate that states its constraints


@dataclass(frozen=True)
class LegChecked:
    """What is proved of one leg. Neither accepted nor refused: the run says that the leg is not certified."""

    leg: int
    certificate: str | None
    accepted: Accepted | None = None
    refused: str | None = None
    support: Accepted | None = None  # that the leg's support alone proves a lower bound
    ranges: Accepted | None = None  # of the parameters at a tolerance


def check_run(folder: Path, *, work: int = WORK) -> list[LegChecked]:
    """What is proved of every leg of the run.

    Raises Unusable where there is nothing to check, Refused where the run as a whole is not what it says.
    `work`: multiplications that each certificate may cost.
    """
    if not folder.is_dir():
        raise Unusable(f"{shown(folder.name)} is no folder")
    with opened(folder / RESULT_NAME) as stream:
        content = stream.read(_LARGEST + 1)
    campaign = ExactCampaign(folder / NAME)
    try:
        if len(content) > _LARGEST:
            raise ValueError(f"is larger than {_LARGEST} bytes")
        result = parsed(content, floats=_number)
        if not isinstance(result, dict) or result.get("format") != RESULT_FORMAT:
            raise ValueError(f"is not of format {RESULT_FORMAT}")
        run = _Run(folder, result, campaign, work)
        return [run.checked(leg) for leg in run.legs()]
    except (KeyError, TypeError, ValueError, IndexError, RecursionError, OverflowError, MemoryError) as error:
        raise Refused(0, f"{RESULT_NAME} {_reason(error)}") from None


@dataclass(frozen=True)
class _Run:
    folder: Path
    result: dict[str, Any]
    campaign: ExactCampaign
    work: int

    def legs(self) -> list[dict[str, Any]]:
        """The legs, after what is stated of all of them was compared. Raises ValueError and the like."""
        stated, campaign = self.result["campaign"], self.campaign
        _same("campaign SHA-256", stated["sha256"], campaign.sha256)
        _same("number of measurements", stated["measurements"], len(campaign))
        _same("name of the robot", stated["robot"], campaign.robot)
        legs: list[dict[str, Any]] = self.result["legs"]
        numbers = [leg["leg"] for leg in legs]
        if any(type(n) is not int or not 1 <= n <= campaign.legs for n in numbers) or len(set(numbers)) < len(numbers):
            raise ValueError("names a leg that the campaign has not, or one twice")
        wanted = self.result["options"]["legs"] or list(range(1, campaign.legs + 1))
        if self.result["interrupted"] is not True and numbers != wanted:
            raise ValueError("lacks legs that it was asked about, and does not say that it was interrupted")
        named = {str(leg["certificate"]) for leg in legs if leg["certificate"] is not None}
        named |= {str(leg["ranges"]["certificate"]) for leg in legs if leg["ranges"] is not None}
        named |= {self._support(leg).name for leg in legs if self._support(leg).exists()}
        for name in sorted({path.name for path in self.folder.glob("*.cert.jsonl")} - named):
            raise ValueError(f"does not name the certificate {shown(name)}, which lies beside it")
        return legs

    @property
    def _model(self) -> str:
        return str(self.result["model"]["name"])

    @property
    def _extra(self) -> list[Any]:
        return list(self.result["model"]["parameters"])

    @property
    def _parameters(self) -> list[str]:
        return [*PARAMETERS, *(p["name"] for p in self._extra)]

    def _support(self, leg: dict[str, Any]) -> Path:
        return self.folder / f"leg{leg['leg']}.support.cert.jsonl"

    def checked(self, leg: dict[str, Any]) -> LegChecked:
        number, name, certified = leg["leg"], leg["certificate"], leg["certified"]
        try:
            self._ids(leg)
            if certified is False and name is None:
                return LegChecked(number, None, ranges=self._ranges(leg))
            if certified is not True or not isinstance(name, str) or not _CERTIFICATE.fullmatch(name):
                raise ValueError("is neither certified by a file of the run nor said to be not certified")
            accepted = check(self.folder / name, self.campaign, work=self.work)
            self._problem(accepted, number)
            self._box(accepted, leg, self.result["options"]["eps"])
            self._claims(accepted, leg)
            return LegChecked(number, name, accepted, support=self._supported(leg), ranges=self._ranges(leg))
        except Unusable as error:
            return LegChecked(number, shown(name), refused=str(error))
        except (Refused, KeyError, TypeError, ValueError, IndexError, RecursionError, OverflowError) as error:
            return LegChecked(number, shown(name), refused=_reason(error))

    def _ids(self, leg: dict[str, Any]) -> None:
        support = leg["support"]
        if not set(support) <= set(self.campaign.ids) or len(set(support)) < len(support):
            raise ValueError("its support names a measurement that the campaign has not, or one twice")

    def _supported(self, leg: dict[str, Any]) -> Accepted | None:
        path = self._support(leg)
        if not path.exists():
            return None
        accepted, ids = check(path, self.campaign, work=self.work), self.campaign.ids
        self._problem(accepted, leg["leg"], [k for k, name in enumerate(ids) if name in set(leg["support"])])
        return accepted

    def _problem(self, accepted: Accepted, leg: int, chosen: list[int] | None = None) -> None:
        model, count = self._model, len(self.campaign)
        if model not in EXTRA:  # one of the user's own: the certificate states its constraints
            _same("problem", accepted.about, f"leg {leg}, model {model}, campaign {self.campaign.sha256}")
            _same("unknowns", list(accepted.unknowns), [*_NETWORK, *self._parameters[7:], "eps"])
            return
        _same("leg of the certificate", accepted.leg, leg)
        _same("model", accepted.model, model)
        _same("extra parameters", [p["name"] for p in self._extra], list(EXTRA[model]))
        _same("measurements", list(accepted.chosen), list(range(count)) if chosen is None else chosen)

    def _box(self, accepted: Accepted, leg: dict[str, Any], asked: Any) -> None:
        """The certificate's box is the one that the result states, rounded outward; `asked`: an eps, or None."""
        delta = _exact(self.result["options"]["delta"])
        centers = [_exact(v) for v in leg["center"]]
        _same("size of the center", len(centers), len(accepted.lo) - 1)
        ranges = [(c - delta, c + delta) for c in centers[:7]]
        ranges += [(-_exact(p["half_width"]), _exact(p["half_width"])) for p in self._extra]
        for i, (low, high) in enumerate(ranges):
            slack = (abs(low) + abs(high)) / 2**50
            if not (low - slack <= accepted.lo[i] <= low and high <= accepted.hi[i] <= high + slack):
                raise ValueError(f"states another range of unknown {i} than the certificate")
        if accepted.lo[-1] != (0 if asked is None else _exact(asked)):
            raise ValueError("states another eps than the certificate was asked about")

    def _claims(self, accepted: Accepted, leg: dict[str, Any]) -> None:
        claims, asked = accepted.claims, self.result["options"]["eps"]
        at = None if claims.point is None or claims.point.holds != accepted.chosen else claims.point.at
        if at is not None and any(not a <= v <= b for a, v, b in zip(accepted.lo[:-1], at, accepted.hi, strict=False)):
            at = None
        if asked is not None:
            _same("cap", claims.cap, _exact(asked))
            at = at if at is not None and at[-1] == claims.cap else None
        refuted = claims.infeasible and at is None and (asked is not None or self._all_of_it(accepted))
        if asked is not None:  # only that one is spoken of
            lo: F | str = _exact(asked) if refuted else F(0)
        else:
            lo = "inf" if refuted else claims.eps_lo or F(0)
        _same("eps_lo", leg["eps_lo"], lo)
        _same("eps_hi", leg["eps_hi"], "inf" if at is None else at[-1])
        _same("point", leg["point"] and [_exact(v) for v in leg["point"]], at and list(at[:-1]))
        self._enclosed(leg["enclosure"], accepted)
        if (leg["status"] == "refuted") != refuted or (leg["status"] == "proved" and at is None):
            raise ValueError("states another verdict than is proved")
        if leg["status"] == "proved" and asked is None and at is not None:
            gap = max(_exact(self.result["options"]["gap"]) * at[-1], _CLOSED)
            if at[-1] - _exact(lo) > gap * F(2**20 + 1, 2**20):
                raise ValueError("calls a bracket closed that is wider than the gap")

    def _ranges(self, leg: dict[str, Any]) -> Accepted | None:
        """What the certificate of the parameters' ranges proves, which is what the result states of them."""
        stated = leg["ranges"]
        if stated is None or stated["certificate"] is None:
            return None
        name = stated["certificate"]
        if not isinstance(name, str) or not _CERTIFICATE.fullmatch(name):
            raise ValueError("names no file of the run as the certificate of its ranges")
        accepted = check(self.folder / name, self.campaign, work=self.work)
        self._problem(accepted, leg["leg"])
        self._box(accepted, leg, stated["eps"])
        _same("eps of the ranges", _exact(stated["eps"]), accepted.claims.cap)
        self._enclosed(stated["box"], accepted)
        return accepted

    def _enclosed(self, box: dict[str, Any], accepted: Accepted) -> None:
        _same("parameters", box["names"], self._parameters)
        sides, proved = [box[side] for side in ("lo", "hi")], accepted.claims.enclosure
        hull = None if sides == [None, None] else [[_exact(v) for v in side] for side in sides]
        _same("enclosure", hull, proved and [list(side[:-1]) for side in proved])

    def _all_of_it(self, accepted: Accepted) -> bool:
        """Whether the cap is above every eps for which legs can be longer than eps."""
        rows, cap = self.campaign.of(accepted.leg or 1), accepted.claims.cap
        shortest = min(rows[k].length - rows[k].radii[6] for k in range(len(rows)))
        return cap is not None and cap >= shortest + accepted.hi[6]


def _same(what: str, stated: Any, proved: Any) -> None:
    """Equal, and of the same kind: true is not 1. Raises ValueError."""
    if stated != proved or isinstance(stated, bool) != isinstance(proved, bool):
        raise ValueError(f"states another {what} than is proved")


def _number(text: str) -> F:
    """The float64 nearest to a number of JSON. Raises ValueError."""
    number = float(text)
    if number - number != 0.0:
        raise ValueError(f"holds the number {text[:40]}, which is too large for a float64")
    return F(number)


def _exact(value: Any) -> F:
    if isinstance(value, bool) or not isinstance(value, int | F):
        raise ValueError(f"holds {shown(value)} where a number is needed")
    return F(value)


def _reason(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"lacks the key {shown(error.args[0])}"
    if isinstance(error, (ValueError, Refused)):
        return str(error)
    return "holds a value of the wrong kind"
