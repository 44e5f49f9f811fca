"""Parameters of a Minibex file: quantities of which some value exists."""

from __future__ import annotations

from cpcal.problems.minibex import read_minibex


def test_a_parameter_has_one_value_wherever_it_stands() -> None:
    text = "Parameters p in [1,2], q = 2; Variables x in [0,9]; Parameters r[2] in [0,1]; Constraints {}; end"
    known = read_minibex(text.format("x*p = q; x*p >= 1.9; x + r(1) = 4"), "here").network
    assert not known.solve().solutions  # x is at most 2, and at least 3
    some = read_minibex(text.format("x*p = q"), "here").network.solve(width=0.1)
    assert some.complete
    assert all(any(x in s.box["x"] for s in some.solutions) for x in (1.0, 1.5, 2.0))
    apart = read_minibex(text.format("x*p = q; x*p = 2.5"), "here").network
    assert not apart.solve(width=0.1).solutions
