"""Contractors and strategies found by entry point: the one door for ours and for a third party's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from importlib.metadata import EntryPoint, entry_points
from operator import rshift
from typing import Any, Protocol

from cpcal.errors import PluginError
from cpcal.solver.contract import Contractor, Strategy
from cpcal.solver.network import ConstraintNetwork

GROUP = "cpcal.contractors"
STRATEGY_GROUP = "cpcal.strategies"


class ContractorFactory(Protocol):
    """What an entry point of the group names: usually the contractor's class."""

    def __call__(self, network: ConstraintNetwork, *, objective: str | None, arithmetic: str) -> Contractor: ...


class StrategyFactory(Protocol):
    """What an entry point of the strategies' group names: usually the strategy's class."""

    def __call__(self, network: ConstraintNetwork, width: float, *, arithmetic: str) -> Strategy: ...


def found(group: str = GROUP) -> dict[str, EntryPoint]:
    """The registered contractors (or members of another group) by name, in order of name."""
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda p: p.name)}


def load(name: str) -> ContractorFactory:
    """The factory registered under `name`. Raises PluginError, listing those found, for an unknown one."""
    factory: ContractorFactory = load_member("contractor", name, GROUP)
    return factory


def load_strategy(name: str, ours: Iterable[str] = ()) -> StrategyFactory:
    """The strategy registered under `name`. Raises PluginError for an unknown one, listing them and those of `ours`."""
    factory: StrategyFactory = load_member("strategy", name, STRATEGY_GROUP, ours)
    return factory


def load_member(what: str, name: str, group: str, ours: Iterable[str] = ()) -> Any:
    """What is registered under `name` in a group; `what` it is, for messages. Raises PluginError, as `load`."""
    points = found(group)
    if name not in points:
        raise PluginError(
            f"no {what} is called {name!r}; found: {', '.join([*ours, *points]) or 'none'}. To register one, name its "
            f'factory in your package\'s pyproject.toml under [project.entry-points."{group}"] and install it'
        )
    try:
        return points[name].load()
    except Exception as error:
        raise PluginError(f"{what} {name!r} ({points[name].value}) does not load: {error!r}") from error


def check_names(names: Sequence[str | Contractor]) -> None:
    """Raises PluginError where there is no name, or no such contractor."""
    if isinstance(names, str) or not isinstance(names, (Sequence, type(None))):
        raise PluginError(f"contractors={names!r} is no list: write contractors=[{names!r}]")
    if not names:
        raise PluginError(f"name at least one contractor; found: {', '.join(found()) or 'none'}")
    for name in names:
        if isinstance(name, str):
            load(name)
        elif not hasattr(name, "contract"):
            raise PluginError(f"{name!r} is no contractor: give its name or an object with contract(box)")


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
    return composed(build_each(network, names, objective=objective, arithmetic=arithmetic), names)


def composed(parts: Sequence[Contractor], names: Sequence[str | Contractor]) -> Contractor:
    """Contractors of those names, one after the other. Raises PluginError."""
    try:
        return reduce(rshift, parts)
    except TypeError as error:
        raise PluginError(
            f"{', '.join(map(str, names))} do not compose: contractors need the operator >> ({error})"
        ) from error
