"""`cpcal plugins`: what other packages, and this one, provide by entry point."""

from __future__ import annotations

from collections.abc import Callable

from rich import box
from rich.table import Table

from cpcal.cli.terminal import terminal
from cpcal.common.errors import ClashError, CpcalError, printable
from cpcal.legs import leg_model, models
from cpcal.solver import plugins as registry

_GROUPS: dict[str, tuple[str, Callable[[str], object]]] = {
    registry.GROUP: ("contractor", registry.load),
    registry.STRATEGY_GROUP: ("strategy", registry.load_strategy),
    models.GROUP: ("leg model", leg_model),
}


def plugins() -> None:
    """List the contractors, search strategies and leg models found, whose they are, and whether they load.

    With exit status 2 where two packages register the same name: nobody can use it.
    """
    clashes: list[CpcalError] = []
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for heading in ("name", "what", "from", "package", "loads"):
        table.add_column(heading, overflow="fold")
    for group, (what, load) in _GROUPS.items():
        for name, point in registry.found(group).items():
            package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
            error = _error(name, load)
            clashes += [error] if isinstance(error, ClashError) else []
            row = (name, what, point.value, package, "yes" if error is None else str(error))
            table.add_row(*map(printable, row))
    console = terminal()
    console.print(table)
    console.print(f"Found through the entry-point groups {', '.join(_GROUPS)}.", soft_wrap=True)
    if clashes:
        raise clashes[0]


def _error(name: str, load: Callable[[str], object]) -> CpcalError | None:
    try:
        load(name)
    except CpcalError as error:
        return error
    return None
