"""Forgeries by hand: each is refused, at the line where the lie is told, by both checkers."""

import json
from collections.abc import Iterator
from functools import reduce
from itertools import islice
from operator import getitem
from typing import Any

import pytest

from cpcal.checker import Refused
from tests.checker.forged.forgeries import FORGERIES, HEAD, PROOFS
from tests.checker.second import agreed, encoded, told

CASES = [(name, kind) for name, (*_, kinds) in FORGERIES.items() for kind in kinds]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_forgeries_are_refused_at_their_line(name, kind, request, verdict, second):
    proof = request.getfixturevalue(PROOFS[kind])
    lines = proof.copy()
    where, change, _ = FORGERIES[name]
    change(lines, proof)
    assert json.dumps(lines) != json.dumps(proof.lines)
    if isinstance(where, int):
        expected = 1 + where + (proof.head - HEAD if where >= HEAD - 1 else 0)
    else:
        expected = {"last": len(lines), "constraint": 2}.get(where) or 1 + proof.index(where)
    with pytest.raises(Refused) as caught:
        verdict(lines, proof.folder)
    assert caught.value.line == expected, str(caught.value)
    assert str(caught.value).startswith(f"line {expected}: ")
    assert str(caught.value).isascii()
    assert str(caught.value).isprintable()
    if second is not None:
        content = encoded(lines)
        assert agreed(told(caught.value, content), second(content, proof.folder))


OTHERS = (True, None, 1.5, 10**4000, "1.5", "\x1b[2J\u202e\n\ud800" * 10_000, [], {})
NULL_IS_ONE = {"only", "objective", "at_least", "at_most", "epsilon", "enclosure", "readings", "factor", "hi"}


def kind_of(value: Any) -> Any:
    return (type(value), value[:2] in ("0x", "-0")) if isinstance(value, str) else type(value)


def places(value: Any, *path: Any) -> Iterator[tuple[Any, ...]]:
    """Of every value in a line; of a list of values of one kind, of its first."""
    if path:
        yield path
    keys = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    seen: list[Any] = []
    for key in keys:
        if isinstance(value, list) and kind_of(value[key]) in seen and len(value) > 5:
            continue
        seen.append(kind_of(value[key]))
        yield from places(value[key], *path, key)


def altered(proof: Any, kind: str) -> Iterator[tuple[Any, int, Any]]:
    """Lines of which one is changed, its index, and what was changed."""
    count = 0
    for index in (*range(1 + (kind == "network")), *range(proof.head, proof.head + 4)):
        for path in places(proof.lines[index]):
            *keys, end = path
            old = reduce(getitem, path, proof.lines[index])
            others = [v for v in OTHERS if kind_of(v) != kind_of(old) and not (v is None and end in NULL_IS_ONE)]
            others += [-(1 << 61)] * (type(old) is int)
            changes = [("=", v) for v in (others if len(path) < 3 else others[count % 3 :: 3])]
            changes += [("more", 0)] * isinstance(old, dict) + [("less", 0)] * isinstance(end, str)
            for change, value in changes:
                lines, count = proof.copy(), count + 1
                target = reduce(getitem, keys, lines[index])
                if change == "=":
                    target[end] = value
                elif change == "more":
                    target[end]["note"] = "trust me"
                else:
                    del target[end]
                yield lines, index, (path, change, value)
        lines = proof.copy()
        lines[index]["note"] = "trust me"
        yield lines, index, "note"


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.nightly)])  # of so many changes one
@pytest.mark.parametrize("kind", ["leg", "network", "gain"])
def test_values_of_another_kind_keys_too_many_and_too_few_are_refused_at_their_line(
    kind: str, every: int, request: pytest.FixtureRequest, verdict: Any, second: Any
) -> None:
    proof, count = request.getfixturevalue(PROOFS[kind]), 0
    for lines, index, what in islice(altered(proof, kind), 0, None, every):
        with pytest.raises(Refused) as caught:
            verdict(lines, proof.folder)
        said, count = str(caught.value), count + 1
        assert caught.value.line == index + 1, (what, said)
        assert said.isascii() and said.isprintable() and len(said) < 300  # noqa: PT018 - nothing hostile is shown
        if second is not None:
            content = encoded(lines)
            agreed(told(caught.value, content), second(content, proof.folder))
    assert count > 150 / every
