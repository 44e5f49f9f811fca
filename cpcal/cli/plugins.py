"""`cpcal plugins`: the contractors found."""

from __future__ import annotations

from importlib.metadata import EntryPoint

from rich import box
from rich.table import Table

from cpcal.cli.show import terminal
from cpcal.errors import PluginError, printable
from cpcal.solver import plugins as registry


def plugins() -> None:
    """List the contractors found, whose they are, and whether they load."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for name in ("contractor", "from", "package", "loads"):
        table.add_column(name, overflow="fold")
    for name, point in registry.found().items():
        package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
        table.add_row(printable(name), printable(point.value), printable(package), printable(_loads(name, point)))
    console = terminal()
    console.print(table)
    console.print(f"Found through the entry-point group {registry.GROUP}.", soft_wrap=True)


def _loads(name: str, point: EntryPoint) -> str:
    try:
        registry.load(name)
    except PluginError as error:
        return str(error)
    return "yes"
