"""Draw which folder imports which, of any revision: boxes on floors, arrows down, red where an arrow climbs.

    python docs/draw_imports.py                                today's files: counts
    python docs/draw_imports.py --revision 45306d2             of a revision
    python docs/draw_imports.py --inside cpcal.solver          what one folder holds
    python docs/draw_imports.py -o docs/pictures/today.svg     the drawing

A room is a folder or file directly in cpcal, and each other package of the repository that is not tests. An arrow goes
from a room to one that it imports, type-checking imports and the lazily loaded names of an `__init__.pyi` included. A
room's floor is one above the highest that it imports; rooms that import each other are a circle and share one.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from html import escape
from pathlib import Path

import grimp

PACKAGES = ("cpcal", "contractors", "benchmarks")
WIDTH, HEIGHT, GAP, FLOOR = 118, 30, 16, 74  # of the drawing, in pixels


@dataclass(frozen=True)
class Plan:
    """`floors` of rooms, lowest first; `arrows` to what is imported; `circles` of rooms that import each other."""

    floors: tuple[tuple[str, ...], ...]
    arrows: frozenset[tuple[str, str]]
    circles: tuple[tuple[str, ...], ...]

    @property
    def rooms(self) -> int:
        return sum(map(len, self.floors))

    def counts(self) -> str:
        return f"{self.rooms} rooms, {len(self.arrows)} arrows, {len(self.circles)} circles, {len(self.floors)} floors"


def checked_out(repository: Path, revision: str | None, folder: Path) -> None:
    """The packages of a revision, or of the work tree, in `folder`; stubs in the place of the files they describe."""
    if revision is None:
        for name in PACKAGES:
            shutil.copytree(repository / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    else:
        archive = ["git", "-C", str(repository), "archive", revision, *PACKAGES]
        tree = subprocess.run(archive, check=True, capture_output=True)
        subprocess.run(["tar", "-x", "-C", str(folder)], input=tree.stdout, check=True)
    for stub in folder.rglob("__init__.pyi"):
        stub.replace(stub.with_suffix(".py"))


def room(module: str, inside: str) -> str | None:
    """The room of a module; None outside of what is drawn."""
    parts, depth = module.split("."), inside.count(".") + 1
    if inside == "cpcal" and parts[0] != "cpcal":
        return parts[0]
    if inside != "cpcal" and module == inside:
        return None
    return ".".join(parts[: depth + 1]) if f"{module}.".startswith(f"{inside}.") else None


def plan(folder: Path, inside: str = "cpcal", without: tuple[str, ...] = ()) -> Plan:
    """The rooms of the packages in `folder`, but those `without` which it is asked for."""
    sys.path.insert(0, str(folder))
    try:
        graph = grimp.build_graph(*PACKAGES, cache_dir=None, exclude_type_checking_imports=False)
    finally:
        sys.path.remove(str(folder))
    rooms, arrows = set(), set()
    for module in graph.modules:
        importer = room(module, inside)
        if importer is None or importer in without:
            continue
        rooms.add(importer)
        for name in graph.find_modules_directly_imported_by(module):
            imported = room(name, inside)
            if imported is not None and imported not in (importer, *without):
                arrows.add((importer, imported))
    return arranged(rooms, arrows)


def arranged(rooms: set[str], arrows: set[tuple[str, str]]) -> Plan:
    """Rooms on floors: each as low as what it imports lets it be."""
    below = {a: {b for x, b in arrows if x == a} for a in rooms}
    reached = {a: _reached(a, below) for a in rooms}
    together = {a: frozenset({a} | {b for b in reached[a] if a in reached[b]}) for a in rooms}

    def floor(group: frozenset[str]) -> int:
        return max((1 + floor(together[b]) for a in group for b in below[a] - group), default=0)

    height = {a: floor(together[a]) for a in rooms}
    floors = tuple(tuple(sorted(a for a in rooms if height[a] == k)) for k in range(max(height.values()) + 1))
    circles = tuple(sorted({tuple(sorted(group)) for group in together.values() if len(group) > 1}))
    return Plan(floors, frozenset(arrows), circles)


def _reached(start: str, below: dict[str, set[str]]) -> set[str]:
    found: set[str] = set()
    ahead = [start]
    while ahead:
        for name in below[ahead.pop()] - found:
            found.add(name)
            ahead.append(name)
    return found


def svg(drawn: Plan, title: str) -> str:
    """The plan as SVG: the highest floor on top; an arrow leaves a box at its bottom and enters at the top."""
    broadest = max(map(len, drawn.floors))
    width, height = broadest * (WIDTH + GAP) + GAP, len(drawn.floors) * FLOOR + 40
    place = {}
    for k, floor in enumerate(reversed(drawn.floors)):
        left = (width - len(floor) * (WIDTH + GAP) + GAP) / 2
        place |= {name: (left + i * (WIDTH + GAP), 36 + k * FLOOR) for i, name in enumerate(floor)}
    lines = [_arrow(place[a], place[b]) for a, b in sorted(drawn.arrows)]
    boxes = [_box(name, *place[name]) for name in sorted(place)]
    style = "font-family='sans-serif' font-size='12'"
    head = f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' {style}>"
    back = f"<rect width='{width}' height='{height}' fill='white'/>"
    text = f"<text x='{GAP}' y='22' font-size='14'>{escape(title)}: {drawn.counts()}</text>"
    return "\n".join([head, back, text, *lines, *boxes, "</svg>"]) + "\n"


def _box(name: str, x: float, y: float) -> str:
    label = escape(name.removeprefix("cpcal.") if name.count(".") < 2 else name.rpartition(".")[2])
    frame = f"<rect x='{x:g}' y='{y:g}' width='{WIDTH}' height='{HEIGHT}' rx='5' fill='#eef3fa' stroke='#2b4a6f'/>"
    return f"{frame}<text x='{x + WIDTH / 2:g}' y='{y + 20:g}' text-anchor='middle'>{label}</text>"


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    down = start[1] < end[1]
    x, y = start[0] + WIDTH / 2, start[1] + (HEIGHT if down else 0)
    u, v = end[0] + WIDTH / 2, end[1] + (0 if down else HEIGHT)
    bend = (v - y) / 2 if v != y else -FLOOR / 2
    colour = "#8aa0b8" if down else "#c53030"
    path = f"M{x:g} {y:g}C{x:g} {y + bend:g} {u:g} {v - bend:g} {u:g} {v:g}"
    return f"<path d='{path}' fill='none' stroke='{colour}' stroke-opacity='0.7'/>"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--revision", help="of git (default: the files as they are)")
    parser.add_argument("--inside", default="cpcal", help="the package whose members are the rooms")
    parser.add_argument("--folders", action="store_true", help="leave out single files, benchmarks, the public names")
    parser.add_argument("-o", "--output", type=Path, help="the drawing, as SVG")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        checked_out(Path(__file__).parents[1], options.revision, Path(folder))
        files = tuple(f"cpcal.{path.stem}" for path in Path(folder, "cpcal").glob("*.py"))
        drawn = plan(Path(folder), options.inside, ("cpcal", "benchmarks", *files) if options.folders else ())
    print(drawn.counts())
    for k, floor in reversed(list(enumerate(drawn.floors))):
        print(f"{k:3}  {', '.join(floor)}")
    for circle in drawn.circles:
        print(f"circle: {', '.join(circle)}")
    if options.output:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        title = options.inside if options.revision is None else f"{options.inside} at {options.revision}"
        options.output.write_text(svg(drawn, title), encoding="utf-8")


if __name__ == "__main__":
    main()
