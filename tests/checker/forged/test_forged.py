"""Forgeries by hand: each is refused, at the line where the lie is told, by both checkers."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cpcal.checker import Refused
from tests.checker.forged import forged_claims, forged_steps, forged_values
from tests.checker.forged.forging import FORGERIES, PROOFS
from tests.checker.second import agreed, encoded, told

assert all((forged_claims, forged_steps, forged_values))  # to load them fills FORGERIES
CASES = [(name, kind) for name, (_, kinds) in FORGERIES.items() for kind in kinds]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_forgeries_are_refused_at_their_line(
    name: str, kind: str, request: pytest.FixtureRequest, verdict: Any, second: Any
) -> None:
    proof = request.getfixturevalue(PROOFS[kind])
    lines = proof.copy()
    where = FORGERIES[name][0](lines, proof)
    assert json.dumps(lines) != json.dumps(proof.lines)
    expected = 1 + (where if isinstance(where, int) else len(lines) - 1 if where == "last" else proof.index(where))
    if where == "constraint":
        expected = 2
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
