"""Contractors found by entry point: the one door for ours and for a third party's."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from importlib.metadata import EntryPoint, entry_points
from operator import rshift
from typing import Protocol

from cpcal.errors import PluginError
from cpcal.interfaces import Contractor
from cpcal.network import ConstraintNetwork

GROUP = "cpcal.contractors"


class ContractorFactory(Protocol):
    """What an entry point of the group names: usually the contractor's class."""

    def __call__(self, network: ConstraintNetwork, *, objective: str | None, arithmetic: str) -> Contractor: ...


def found() -> dict[str, EntryPoint]:
    """The registered contractors by name, in order of name."""
    return {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda p: p.name)}


def load(name: str) -> ContractorFactory:
    """The factory registered under `name`. Raises PluginError, listing those found, for an unknown one."""
    points = found()
    if name not in points:
        raise PluginError(
            f"no contractor is called {name!r}; found: {', '.join(points) or 'none'}. To register one, name its "
            f'factory in your package\'s pyproject.toml under [project.entry-points."{GROUP}"] and install it'
        )
    try:
        factory: ContractorFactory = points[name].load()
    except Exception as error:
        raise PluginError(f"contractor {name!r} ({points[name].value}) does not load: {error!r}") from error
    return factory


def load_all(names: Sequence[str]) -> list[ContractorFactory]:
    """The factories of at least one name. Raises PluginError."""
    if not names:
        raise PluginError(f"name at least one contractor; found: {', '.join(found()) or 'none'}")
    return [load(name) for name in names]


def build_each(
    network: ConstraintNetwork,
    names: Sequence[str],
    *,
    objective: str | None = None,
    arithmetic: str = "float64",
) -> list[Contractor]:
    """The named contractors for a network, at least one. Raises PluginError."""
    return [factory(network, objective=objective, arithmetic=arithmetic) for factory in load_all(names)]


def build(
    network: ConstraintNetwork,
    names: Sequence[str],
    *,
    objective: str | None = None,
    arithmetic: str = "float64",
) -> Contractor:
    """The named contractors, one after the other, for a network. Raises PluginError."""
    return composed(build_each(network, names, objective=objective, arithmetic=arithmetic), names)


def composed(parts: Sequence[Contractor], names: Sequence[str]) -> Contractor:
    """Contractors of those names, one after the other. Raises PluginError."""
    try:
        return reduce(rshift, parts)
    except TypeError as error:
        raise PluginError(f"{', '.join(names)} do not compose: contractors need the operator >> ({error})") from error
