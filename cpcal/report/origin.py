"""Where a page comes from: the command that repeats the run, and the versions at work."""

from __future__ import annotations

import shlex
from importlib.metadata import PackageNotFoundError, version

from cpcal.common.version import __version__
from cpcal.results import Result

_PACKAGES = ("numpy", "scipy", "ortools", "python-flint")


def command(result: Result) -> str:
    """The `cpcal certify` command that asks the same again, for a shell; the two folders are placeholders."""
    return shlex.join(["cpcal", "certify", "CAMPAIGN", "-o", "RUN", *result.options.words()])


def versions() -> str:
    """Of cpcal and of what it computes and draws with, here and now."""
    return ", ".join([f"cpcal {__version__}", *(f"{name} {_version(name)}" for name in _PACKAGES)])


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "of unknown version"
