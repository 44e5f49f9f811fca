"""Contractors and strategies found by entry point: the one door for ours and for a third party's."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import ClashError, PluginError
from cpcal.solver.contract import Contractor, ContractorFactory, StrategyFactory, in_sequence

if TYPE_CHECKING:
    from cpcal.solver.network import ConstraintNetwork

GROUP = "cpcal.contractors"
STRATEGY_GROUP = "cpcal.strategies"


def found(group: str = GROUP) -> dict[str, EntryPoint]:
    """The registered contractors (or members of another group) by name, in order of name."""
    return {point.name: point for point in _registered(group)}


def load(name: str) -> ContractorFactory:
    """The factory registered under `name`.

    Raises PluginError for an unknown one, listing those found, for one that two packages register, naming both, and
    for one that does not load.
    """
    factory: ContractorFactory = load_member("contractor", name, GROUP)
    return factory


def load_strategy(name: str, ours: Iterable[str] = ()) -> StrategyFactory:
    """The strategy registered under `name`. Raises PluginError as `load` does; `ours` are listed too."""
    factory: StrategyFactory = load_member("strategy", name, STRATEGY_GROUP, ours)
    return factory


def load_member(what: str, name: str, group: str, ours: Iterable[str] = ()) -> Any:
    """What is registered under `name` in a group; `what` it is, for messages. Raises PluginError, as `load`."""
    points = _registered(group)
    named = [point for point in points if point.name == name]
    if not named:
        raise PluginError(
            f"no {what} is called {name!r}; found: {', '.join([*ours, *(p.name for p in points)]) or 'none'}. To "
            f'register one, name its factory in your package\'s pyproject.toml under [project.entry-points."{group}"] '
            "and install it"
        )
    if len(named) > 1:
        claims = " and ".join(f"{_package(point)} ({point.value})" for point in named)
        raise ClashError(f"two packages register a {what} {name!r}: {claims}; rename or uninstall one of them")
    try:
        return named[0].load()
    except Exception as error:
        shadow = _shadow(named[0])
        raise PluginError(f"{what} {name!r} ({named[0].value}) does not load: {error!r}{shadow}") from error


def _registered(group: str) -> tuple[EntryPoint, ...]:
    return _scanned(entry_points, group, tuple(sys.path))


@lru_cache(maxsize=16)
def _scanned(scan: Callable[..., EntryPoints], group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """In order. To read the metadata of all packages takes longer than to bracket a leg: once for each `path`."""
    return tuple(sorted(scan(group=group), key=lambda point: (point.name, _package(point), point.value)))


def _package(point: EntryPoint) -> str:
    return "a package without a name" if point.dist is None else str(point.dist.name)


def _shadow(point: EntryPoint) -> str:
    """What is said where a folder that is not the plug-in's own comes first on the path, else nothing."""
    package, _, rest = point.module.partition(".")
    spec = importlib.util.find_spec(package)
    if spec is None or not rest:
        return ""
    try:
        if importlib.util.find_spec(point.module) is not None:
            return ""  # the module is there: its own error says what is wrong
    except ModuleNotFoundError:
        pass
    where = ", ".join(spec.submodule_search_locations or [str(spec.origin)])
    return (
        f". The {package!r} that Python finds first is {where}, which has no {rest!r}: "
        f"it is not the one of {_package(point)}. Rename that folder, or start somewhere else"
    )


def check_names(names: Sequence[str | Contractor]) -> None:
    """Raises PluginError where there is no name, no such contractor, or an object that is none."""
    if isinstance(names, str) or not isinstance(names, (Sequence, type(None))):
        raise PluginError(f"contractors={names!r} is no list: write contractors=[{names!r}]")
    if not names:
        raise PluginError(f"name at least one contractor; found: {', '.join(found()) or 'none'}")
    for name in names:
        if isinstance(name, str):
            load(name)
        elif not callable(getattr(name, "contract", None)):
            raise PluginError(f"{name!r} is no contractor: give its name or an object with contract(box)")


def name_of(contractor: str | Contractor) -> str:
    """What a contractor is called in results: the name it was asked for by, or its class."""
    return contractor if isinstance(contractor, str) else type(contractor).__name__


def build_each(
    network: ConstraintNetwork,
    names: Sequence[str | Contractor],
    *,
    objective: str | None = None,
    arithmetic: str = "float64",
) -> list[Contractor]:
    """The named contractors (or those given) for a network, at least one. Raises PluginError."""
    check_names(names)
    return [
        load(name)(network, objective=objective, arithmetic=arithmetic) if isinstance(name, str) else name
        for name in names
    ]


def build(
    network: ConstraintNetwork,
    names: Sequence[str | Contractor],
    *,
    objective: str | None = None,
    arithmetic: str = "float64",
) -> Contractor:
    """The named contractors (or those given), one after the other, for a network. Raises PluginError."""
    return in_sequence(build_each(network, names, objective=objective, arithmetic=arithmetic))
