"""Contractors and strategies found by entry point: the one door for ours and for a third party's."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import Distribution, EntryPoint, EntryPoints, entry_points
from importlib.util import module_from_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import ClashError, PluginError
from cpcal.solver.contract import Contractor, Named

if TYPE_CHECKING:
    from cpcal.solver.network import ConstraintNetwork

GROUP = "cpcal.contractors"
STRATEGY_GROUP = "cpcal.strategies"
LEG_GROUP = "cpcal.leg_models"
KINDS = {GROUP: "contractor", STRATEGY_GROUP: "strategy", LEG_GROUP: "leg model"}


def found(group: str = GROUP) -> dict[str, EntryPoint]:
    """The registered contractors (or members of another group) by name, in order of name."""
    return {point.name: point for point in _scanned(entry_points, group, tuple(sys.path))}


def load(name: str, group: str = GROUP, ours: Iterable[str] = ()) -> Any:
    """What is registered under `name` in a group: the factory of a contractor or of a strategy, or a leg model.

    Raises PluginError for an unknown one, listing `ours` and those found, for one that two packages register, naming
    both, and for one that does not load.
    """
    what = KINDS.get(group, "plug-in")
    points = _scanned(entry_points, group, tuple(sys.path))
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
        return _loaded(named[0], named[0].dist)
    except Exception as error:
        raise PluginError(f"{what} {name!r} ({named[0].value}) does not load: {error!r}") from error


_ROOT = str(Path(__file__).parents[2])
_OURS = "contractors"  # the package of our contractors, a name that others use, too


@lru_cache(maxsize=64)
def _loaded(point: EntryPoint, dist: Distribution | None) -> Any:  # points are equal by their texts alone
    """Ours from beside cpcal, also where another module of that name comes first.

    That one is not run: a file contractors.py where Python was started is somebody's own. It keeps its name, and our
    modules are found in it, too, so that what is pickled by their names is unpickled.
    """
    if point.module.partition(".")[0] != _OURS or _package(point) != "cpcal":
        return point.load()
    own, first = PathFinder.find_spec(_OURS, [_ROOT]), sys.modules.get(_OURS)
    if own is None:
        return point.load()
    if first is not None:
        path = vars(first).setdefault("__path__", [])
        path += [folder for folder in own.submodule_search_locations or [] if folder not in path]
        return point.load()
    spec = PathFinder.find_spec(_OURS)
    if spec is not None and spec.origin == own.origin:
        return point.load()
    sys.modules[_OURS] = module_from_spec(own)
    try:
        return point.load()
    finally:
        del sys.modules[_OURS]


class _Shared(MetaPathFinder):
    """Finds a module that has the name of our package, and lets it have our submodules, too."""

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name) if path is None and name == _OURS else None
        if spec is not None:
            ours = str(Path(_ROOT) / _OURS)
            found = spec.submodule_search_locations or []
            spec.submodule_search_locations = [*found, *([] if ours in found else [ours])]
        return spec


sys.meta_path.insert(0, _Shared())


@lru_cache(maxsize=16)
def _scanned(scan: Callable[..., EntryPoints], group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """In order. To read the metadata of all packages takes longer than to bracket a leg: once for each `path`."""
    return tuple(sorted(scan(group=group), key=lambda point: (point.name, _package(point), point.value)))


def _package(point: EntryPoint) -> str:
    return "a package without a name" if point.dist is None else str(point.dist.name)


def check_names(names: Sequence[str | Contractor]) -> None:
    """Raises PluginError where there is no name, no such contractor, or an object that is none."""
    if isinstance(names, str) or not isinstance(names, (Sequence, type(None))):
        raise PluginError(f"contractors={names!r} is no list: write contractors=[{names!r}]")
    if not names:
        raise PluginError(f"name at least one contractor; found: {', '.join(found()) or 'none'}")
    for name in names:
        if isinstance(name, str):
            load(name)
        elif isinstance(name, type):
            raise PluginError(f"{name.__name__} is a class: give its name, or an object, {name.__name__}(network, ...)")
        elif not callable(getattr(name, "contract", None)):
            raise PluginError(f"{name!r} is no contractor: give its name or an object with contract(box)")


def build_each(
    network: ConstraintNetwork, names: Sequence[str | Contractor], *, objective: str | None = None
) -> list[Named]:
    """The named contractors (or those given) for a network, at least one, with what they are called in results: the
    name that one was asked for by, or its class. Raises PluginError."""
    check_names(names)
    return [
        (name, load(name)(network, objective=objective)) if isinstance(name, str) else (type(name).__name__, name)
        for name in names
    ]
