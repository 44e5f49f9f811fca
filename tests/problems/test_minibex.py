"""Minibex: each feature means what the language says; what is wrong has its line and column."""

import math
import random

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.common.errors import Problem as Wrong
from cpcal.problems.minibex import read_minibex
from cpcal.problems.values import StatedProblem
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box, Interval
from cpcal.solver.network import evaluate

HEAD = "Variables x in [1,3]; y in [2,2]; v[3] in [1,2]; M[2][3] in [0,1];\n"


def read(text: str) -> StatedProblem:
    return read_minibex(text, "problem.bch")


def residual(body: str, head: str = HEAD, at: dict[str, float] | None = None) -> Interval:
    """The body of the constraint `body = 0` at a point: x 2, y 2, v 1.25 1.5 1.75, M 0.1 0.2 ... unless told."""
    network = read(f"{head}Constraints {body} = 0; end").network
    given = {"x": 2.0, "y": 2.0, **{f"v[{k}]": 1.25 + 0.25 * k for k in range(3)}}
    given |= {f"M[{i},{j}]": 0.1 * (3 * i + j + 1) for i in range(2) for j in range(3)}
    point = [(at or given).get(name, 0.0) for name in network.names]
    (constraint,) = network.constraints
    found = evaluate(network, constraint.body, Box(network.names, point, point))
    return Interval(float(found.lo), float(found.hi))


@pytest.mark.parametrize(
    ("body", "value"),
    [
        ("-x^2", -4.0),
        ("-x*3 + x", -4.0),
        ("2^3^2*x/x", 64.0),  # from the left
        ("x - y - 1", -1.0),
        ("x*2/4", 1.0),
        ("x^-2", 0.25),
        ("sqrt(x*8) + sqr(x) + abs(-x)", 10.0),
        ("max(x, 5, 3) - min(x, 1)", 4.0),
        ("v(1) + v[0]", 2.5),  # from 1, and from 0
        ("v(3) - v[2]", 0.0),
        ("M(2,3) + M[0][1]", 0.8),
        ("M(2)(1)", 0.4),
        ("v*v", 1.25**2 + 1.5**2 + 1.75**2),
        ("(M*v)(1)", 0.1 * 1.25 + 0.2 * 1.5 + 0.3 * 1.75),
        ("((1,2)*(M*v))", 0.95 + 2 * (0.4 * 1.25 + 0.5 * 1.5 + 0.6 * 1.75)),
        ("((x;y) - (1;1))(2)", 1.0),
        ("((1,2);(3,4))(2,1)*x", 6.0),
        ("sum(i=1:3, i*v(i))", 1.25 + 3.0 + 5.25),
        ("x*(1/3) - x/3", 0.0),
        ("1e2*x - .5 - 3.", 196.5),
        ("x // a comment\n + /* another */ y", 4.0),
        ("M(2)(3) + M(1)(2)", 0.8),  # one index of a row
        ("M(1)*v", 0.1 * 1.25 + 0.2 * 1.5 + 0.3 * 1.75),
        ("((v;x)(4))", 2.0),  # a number below a vector
        ("((M;(1,2,3)))(3,2)*x", 4.0),  # a row below a matrix
        ("asinh(x) + asinh(-x/2)", math.asinh(2.0) - math.asinh(1.0)),
        ("acosh(x) + atanh(1/x)", math.acosh(2.0) + math.atanh(0.5)),
    ],
)
def test_an_expression_has_its_value(body: str, value: float) -> None:
    found = residual(body)
    assert found.lo - 1e-12 <= value <= found.hi + 1e-12
    assert found.hi - found.lo < 1e-12


def test_functions_may_come_first_and_constants_may_be_set_by_programs() -> None:
    text = "Constants * a = 2; * b[2] = (3;4);\n function f(x) return a*x + b(2); end Variables x in [0,9];"
    (solution,) = read(f"{text} Constraints f(x) = 10; end").network.solve().solutions
    assert 3.0 in solution.box["x"]


def test_constants_functions_and_loops() -> None:
    text = """
    Constants
      n = 2+1; c[3] = (1;2;3); r[1][2] = (4,5); w[2] in [0,1]; k = c(2)*n;
    Variables
      x[n] in ([0,1];[1,2];[2,oo]), y;
    function f(a, b[3])
      t = a^2;
      return t + b(1)*k;
    end
    FUNCTION g(a) return f(a, (a;a;a)) end
    Constraints
      for i=1:n-1; for j=i:n-1; x(i) + x(j+1) >= c(i) + r(1,2); end; end;
      f(y, x) <= g(y);
    end
    """
    network = read(text).network
    assert network.names == ("x[0]", "x[1]", "x[2]", "y")
    assert (network.domain["x[2]"].lo, network.domain["x[2]"].hi) == (2.0, np.inf)
    assert (network.domain["y"].lo, network.domain["y"].hi) == (-np.inf, np.inf)
    assert len(network.constraints) == 4  # i, j = 1 1, 1 2, 2 2, and the last
    point = Box(network.names, [1.0, 2.0, 5.0, 3.0], [1.0, 2.0, 5.0, 3.0])
    bodies = [evaluate(network, c.body, point) for c in network.constraints]
    np.testing.assert_allclose([b.lo for b in bodies], [1 + 2 - 6, 1 + 5 - 6, 2 + 5 - 7, 9 + 6 - (9 + 18)], atol=1e-12)


def test_data_in_an_interval_means_that_a_value_of_it_exists() -> None:
    """x = e for some e in [1, 2]: of [0, 3] the solutions [1, 2] are left, and 2.5 is none."""
    text = "Constants e in [1,2]; Variables x in [0,3]; Constraints x - e = 0; end"
    box = read(text).network.contract().box
    assert box is not None
    assert abs(box["x"].lo - 1.0) < 1e-9
    assert abs(box["x"].hi - 2.0) < 1e-9
    assert read(text.replace("[0,3]", "[2.5,3]")).network.contract().box.is_empty


def test_relations_and_their_sides() -> None:
    text = "Variables x in [-9,9]; Constraints {} ; end"
    for relation, lo, hi in (
        ("x <= 2", -9, 2),
        ("x >= 2", 2, 9),
        ("x < 2", -9, 2),
        ("2 > x", -9, 2),
        ("(x)*2 = 4", 2, 2),
    ):
        box = read(text.format(relation)).network.contract().box
        assert box is not None
        assert abs(box["x"].lo - lo) < 1e-9
        assert abs(box["x"].hi - hi) < 1e-9


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("", 1, "column 1: the end of the file stands where 'variables' should"),
        ("Variables x;\nConstraints\n x + = 3; end", 3, "column 6: '=' stands where an expression should begin"),
        ("Variables x; Constraints x = 1", 1, "the end of the file stands where ';' should"),
        ("Variables x; Constraints x = 1; end x", 1, "'x' comes after the end"),
        ("Variables x; x; Constraints x = 1; end", 1, "column 14: 'x' is there already"),
        ("Variables sin; Constraints sin = 1; end", 1, "'sin' is there already"),
        ("Variables x;\n\nConstraints\n  x + z = 1; end", 4, "column 7: 'z' is not declared"),
        ("Variables x; Constraints g(x) = 1; end", 1, "'g' is no function"),
        ("Variables x; function f(a) return f(a) end Constraints f(x) = 1; end", 1, "call one another without end"),
        ("Variables x; function f(a) return x end Constraints f(x) = 1; end", 1, "'x' is not declared"),
        ("Variables x; function f(a,b) return a end Constraints f(x) = 1; end", 1, "f takes 2 arguments, not 1"),
        ("Variables v[2]; Constraints v(3) = 1; end", 1, "the index 3 is not from 1 to 2"),
        ("Variables v[2]; Constraints v[2] = 1; end", 1, "the index 2 is not from 0 to 1"),
        ("Variables v[2]; Constraints v + 1 = 1; end", 1, "values of shapes (2,) and () have no sum"),
        ("Variables v[2], w[3]; Constraints v*w = 1; end", 1, "vectors of 2 and 3 entries have no product"),
        ("Variables x[0]; Constraints x = 1; end", 1, "has the dimensions (0,)"),
        ("Variables x[1.5]; Constraints x = 1; end", 1, "a whole number must stand here"),
        ("Variables x[99999999]; Constraints x = 1; end", 1, "has the dimensions (99999999,)"),
        ("Variables x in [2,1]; Constraints x = 1; end", 1, "is not an interval"),
        ("Constants a = b; Variables x; Constraints x = 1; end", 1, "'b' is not declared"),
        ("Variables x in [0,x]; Constraints x = 1; end", 1, "'x' is not declared"),
        ("Variables x, y[2]; Constraints x^y = 1; end", 1, "an exponent must be a scalar"),
        ("Variables x; Constraints 1 = 1; end", 1, "a constraint without a variable"),
        ("Variables x; Constraints x/0 = 1; end", 1, "a division by 0"),
        ("Variables x; Constraints 1 <= x <= 2; end", 1, "a second relation follows"),
        ("Variables x; Maximize x;", 1, "column 14: 'Maximize' stands where Minimize or Constraints should"),
        ("Variables x; Constraints diff(x^2, x) = 1; end", 1, "'diff' is no function"),
        ("Variables x; Constraints asinh(x, x) = 1; end", 1, "asinh does not take 2 arguments"),
        ("Constants a in [0,oo]; Variables x; Constraints x = a; end", 1, "finite ones"),
        ("Variables x; Constraints for i=1:10000000; x = i; end; end", 1, "turns"),
        ("Variables x; Constraints /* x = 1; end", 1, "a comment does not end"),
        ("Variables x; Constraints x = \x00; end", 1, "has no meaning"),
        (f"Variables x; Constraints {'(' * 5000}x = 1; end", 1, "nested more than"),
        (f"Variables x; Constraints {'-' * 5000}x^{'-' * 50}1 = 1; end", 1, "stands where an expression should"),
    ],
)
def test_what_is_wrong_has_its_line_and_column(text: str, line: int, what: str) -> None:
    with pytest.raises(InputError) as caught:
        read(text)
    (problem,) = caught.value.problems
    assert (problem.where, problem.line) == ("problem.bch", line)
    assert what in problem.what
    assert problem.what.startswith("column ")
    assert problem.remedy


def test_mutated_files_end_in_a_line_and_a_column() -> None:
    """500 mutations of a file with every feature: read, or refused at a place; nothing else is raised."""
    rng = random.Random(5)
    text = (
        "Constants n = 3; e in [0.9,1.1]; c[2] = (1;2);\nVariables x[3] in [-1,1], y in [0,oo];\n"
        "function f(a, b[3])\n t = a^2; return t + sum(i=1:3, b(i)); end\nMinimize f(y, x) + max(y, 1/3);\n"
        "Constraints\n for i=1:n-1; x(i) + x(i+1) >= e; end; y <= 2; c*(x(1);x(2)) = 0; end\n"
    )
    refused = 0
    for _ in range(500):
        at = rng.randrange(len(text))
        single = rng.choice("()[];,=<>+-*/^:ixn0#\n\t\0é")
        piece = rng.choice(["", single, text[rng.randrange(len(text)) :][:9], "9" * 400])
        found = told(text[:at] + piece + text[at + rng.randrange(5) :])
        refused += bool(found)
        assert all(p.line and p.what.startswith("column ") for p in found)
    assert 200 < refused < 500


def told(text: str) -> tuple[Wrong, ...]:
    try:
        read(text)
    except InputError as error:
        return tuple(error.problems)
    return ()


def test_exponents_are_numbers_and_expressions() -> None:
    network = read("Variables x in [0.1,5]; y in [0.1,5]; Constraints x^1.5 = 8; y^x = 16; y^0.5 <= 2; end").network
    (only,) = network.solve().solutions
    assert only.verdict is Verdict.PROVED
    assert only.box.mid == pytest.approx([4.0, 2.0])
