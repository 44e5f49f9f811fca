"""Forgeries by hand: each is refused, at the line where the lie is told, by both checkers."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cpcal.checker import Refused
from tests.checker.forged.forgeries import FORGERIES, HEAD, PROOFS
from tests.checker.second import agreed, encoded, told

CASES = [(name, kind) for name, (*_, kinds) in FORGERIES.items() for kind in kinds]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_forgeries_are_refused_at_their_line(
    name: str, kind: str, request: pytest.FixtureRequest, verdict: Any, second: Any
) -> None:
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


def test_there_are_enough() -> None:
    assert sum(kind == "leg" for _, kind in CASES) >= 100
    assert sum(kind == "network" for _, kind in CASES) >= 100
