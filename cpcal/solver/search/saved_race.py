"""Where a race of searches stands between two nodes, as lines of JSON; and a race brought there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from cpcal.solver.interval import Box
from cpcal.solver.search.box_lines import bounds_of, box_of
from cpcal.solver.search.orders import Node
from cpcal.solver.search.race import Contender, Race
from cpcal.solver.search.search import Piece, Search

_COUNTS = ("nodes", "rest", "back", "taken")
_SHARES = ("decided", "before", "most")  # floats, which JSON keeps to the last bit

Line = dict[str, Any]


def lines_of(race: Race, nodes: int) -> Iterator[Line]:
    """A head, then a line a box. The race must stand still meanwhile; `nodes`: of the whole race, to be told again."""
    places = {id(contender): k for k, contender in enumerate(race.contenders)}
    yield {
        "nodes": nodes,
        "rounds": race.rounds,
        "place": race.place,
        "first": None if race.first is None else places[id(race.first)],
        "alive": [places[id(contender)] for contender in race.alive],
        "contenders": [_standing(contender) for contender in race.contenders],
    }
    for k, contender in enumerate(race.contenders):
        if contender.search is not None:
            yield from ({"of": k, **line} for line in _boxes(contender.search))


def brought_there(race: Race, names: tuple[str, ...], lines: Sequence[Mapping[str, Any]]) -> int:
    """Bring a race that has not begun to where another one of the same contenders stood; the nodes that it had taken.

    Raises KeyError, IndexError, TypeError, ValueError for lines that `lines_of` cannot have written.
    """
    head, *boxes = lines
    standings = head["contenders"]
    if [standing["name"] for standing in standings] != [contender.name for contender in race.contenders]:
        raise ValueError("other methods take turns")
    for k, (contender, standing) in enumerate(zip(race.contenders, standings, strict=True)):
        for key in _COUNTS:
            setattr(contender, key, int(standing[key]))
        for key in _SHARES:
            setattr(contender, key, float(standing[key]))
        if standing["created"] is not None:
            contender.search = contender.start()
            _restore(contender.search, names, [line for line in boxes if line["of"] == k], int(standing["created"]))
    race.rounds, race.place = int(head["rounds"]), int(head["place"])
    race.first = None if head["first"] is None else race.contenders[int(head["first"])]
    race.alive = [race.contenders[int(k)] for k in head["alive"]]
    return int(head["nodes"])


def _standing(contender: Contender) -> Line:
    counted = {key: getattr(contender, key) for key in (*_COUNTS, *_SHARES)}
    search = contender.search
    return {"name": contender.name, "created": None if search is None else search.created, **counted}


def _boxes(search: Search) -> Iterator[Line]:
    begun = {node.serial for node in search.begun}
    for node in search.begun:
        yield _node("begun", node)
    for node in search.undecided():
        if node.serial not in begun:
            yield _node("pending", node)
    yield from ({"in": "kept", "box": bounds_of(piece.box)} for piece in search.kept)
    yield from ({"in": "inside", "box": bounds_of(box)} for box in search.inside)
    yield from ({"in": "outside", "box": bounds_of(box)} for box in search.outside)


def _node(where: str, node: Node) -> Line:
    line = {"in": where, "depth": node.depth, "serial": node.serial, "box": bounds_of(node.box)}
    return line if node.state is None else line | {"found": bounds_of(node.state)}


def _restore(search: Search, names: tuple[str, ...], lines: Iterable[Mapping[str, Any]], created: int) -> None:
    nodes: dict[str, list[Node]] = {"begun": [], "pending": []}
    boxes: dict[str, list[Box]] = {"kept": [], "inside": [], "outside": []}
    for line in lines:
        box = box_of(names, line["box"])
        if line["in"] in boxes:
            boxes[line["in"]].append(box)
        else:
            state = box_of(names, line["found"]) if "found" in line else None
            nodes[line["in"]].append(Node(box, int(line["depth"]), int(line["serial"]), state))
    search.restore(
        nodes["pending"],
        map(Piece, boxes["kept"]),
        created,
        begun=nodes["begun"],
        inside=boxes["inside"],
        outside=boxes["outside"],
    )
