"""Where a page comes from: the command that repeats the run, and the versions at work."""

from __future__ import annotations

import shlex
from importlib.metadata import PackageNotFoundError, version

from cpcal.legs import PLAIN
from cpcal.results import Result
from cpcal.robot import Campaign
from cpcal.version import __version__

_PACKAGES = ("numpy", "scipy", "ortools", "python-flint", "matplotlib")


def command(campaign: Campaign, result: Result) -> str:
    """The `cpcal certify` command that asks the same again, for a shell; the two folders are placeholders."""
    words = ["cpcal", "certify", "CAMPAIGN", "-o", "RUN"]
    legs = [leg.leg for leg in result.legs]
    if legs and legs != list(range(1, campaign.legs + 1)) and not result.interrupted:
        words += ["--legs", ",".join(map(str, legs))]
    words += ["--delta", repr(float(result.delta)), "--center", result.center, "--gap", repr(float(result.gap))]
    words += ["--contractors", ",".join(result.contractors), "--arithmetic", result.arithmetic]
    if result.model.name != PLAIN.name:
        words += ["--model", result.model.name]
    if result.eps is not None:
        words += ["--eps", repr(float(result.eps))]
    if result.time_limit is not None:
        words += ["--time-limit", repr(float(result.time_limit))]
    for option, value, usual in (("--method", result.method, "bound"), ("--support", result.support, "few")):
        words += [option, value] if value != usual else []
    return shlex.join(words)


def versions() -> str:
    """Of cpcal and of what it computes and draws with, here and now."""
    return ", ".join([f"cpcal {__version__}", *(f"{name} {_version(name)}" for name in _PACKAGES)])


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "of unknown version"
