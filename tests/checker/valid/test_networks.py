"""Certificates of user-defined constraints: stated exactly, accepted, and true."""

import json
import math
import random
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from cpcal.checker import Accepted, check
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.float_rows import at_point, failing, holding

PLACES = np.array([[4.0, 0.0, 1.0], [2.0, 3.5, 0.5], [-2.0, 3.0, 2.0], [-4.0, 0.5, 0.25], [-1.0, -4.0, 3.0],
                   [2.5, -3.0, 1.5], [0.5, 0.25, 5.0]])  # fmt: skip
TRUTH, OFFSET = np.array([0.3, -0.2, -0.4]), 0.35
NOISE = np.array([0.03, -0.02, 0.01, 0.04, -0.03, 0.0, 0.02])
RANGES = np.round(np.linalg.norm(PLACES - TRUTH, axis=1) - OFFSET + NOISE, 6)


def proved(path: Path) -> Accepted:
    return check(path)


def agrees(found: Accepted, minimum: Any, network: cpcal.Network) -> None:
    claims = found.claims
    assert found.leg is None
    assert found.unknowns == network.names
    assert (claims.eps_lo, claims.eps_hi) == (F(minimum.lo), F(minimum.hi))
    assert claims.point is not None
    assert claims.point.at == tuple(F(float(v)) for v in minimum.witness.point)
    assert claims.enclosure is not None
    for side, values in zip(claims.enclosure, (minimum.enclosure.lo, minimum.enclosure.hi), strict=True):
        assert side == tuple(F(float(v)) for v in values)


def anchors() -> tuple[cpcal.Network, cpcal.Expr]:
    """As docs/examples/hangprinter.py, simulated: an anchor and a length offset."""
    net = cpcal.Network()
    anchor, offset = net.variable("anchor", 3, (-1.0, 1.0)), net.variable("offset", (), (-1.0, 1.0))
    eps = net.variable("eps", (), (0.0, 10.0))
    length = RANGES + offset
    net.add((cpcal.norm(PLACES - anchor) - length).within((-eps, eps)))
    net.add(length >= eps)
    return net, eps


def worst(x: list[F]) -> bool:
    """Whether | ||p - a|| - (r + offset) | <= eps for every place, from the data alone."""
    a, offset, eps = x[:3], x[3], x[4]
    for place, r in zip(PLACES, RANGES, strict=True):
        square = sum(((F(float(p)) - v) ** 2 for p, v in zip(place, a, strict=True)), F(0))
        base = F(float(r)) + offset
        if base < eps or not (base - eps) ** 2 <= square <= (base + eps) ** 2:
            return False
    return True


def test_an_anchor_and_an_offset(tmp_path: Path) -> None:
    net, eps = anchors()
    found = net.minimize(eps, certificate=tmp_path / "a.cert.jsonl")
    assert found.verdict is cpcal.Verdict.PROVED
    accepted = proved(tmp_path / "a.cert.jsonl")
    agrees(accepted, found, net)
    assert accepted.claims.eps_lo is not None
    assert 0 < accepted.claims.eps_lo < F(4, 100)
    assert accepted.objective == 4
    assert accepted.count == 14
    rng = random.Random(0)
    best = [F(float(v)) for v in accepted.claims.point.at]  # type: ignore[union-attr]
    assert worst(best)
    solved = 0
    for n in range(300):
        size = F(10) ** -rng.randint(1, 7)
        x = [v + size * F(rng.randint(-1000, 1000), 1000) for v in best[:4]]
        if n % 3 == 0:
            x = [a + (b - a) * F(rng.random()) for a, b in zip(accepted.lo[:4], accepted.hi[:4], strict=True)]
        if not all(a <= v <= b for a, v, b in zip(accepted.lo, x, accepted.hi, strict=False)):
            continue
        assert not worst([*x, accepted.claims.eps_lo - F(1, 10**15)])
        if worst([*x, accepted.claims.cap]):  # type: ignore[list-item]
            solved += 1
            lo, hi = accepted.claims.enclosure  # type: ignore[misc]
            assert all(a <= v <= b for a, v, b in zip(lo, x, hi, strict=False))
    first = (tmp_path / "a.cert.jsonl").read_bytes()
    net.minimize(eps, certificate=tmp_path / "a.cert.jsonl")
    assert (tmp_path / "a.cert.jsonl").read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["a.cert.jsonl"]


def stated(path: Path) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return lines[1 : 1 + lines[0]["constraints"]]


def test_no_solution_at_all(tmp_path: Path) -> None:
    net = cpcal.Network()
    x, t = net.variable("x", 2, (-1.0, 1.0)), net.variable("t", (), (0.0, 0.5))
    net.add(cpcal.norm(x - np.array([3.0, 3.0])) <= 2.0 + t)
    found = net.minimize(t, certificate=tmp_path / "n.cert.jsonl")
    assert found.verdict is cpcal.Verdict.REFUTED
    claims = proved(tmp_path / "n.cert.jsonl").claims
    assert claims.infeasible
    assert claims.cap == F(1, 2)
    assert claims.point is None


# the exact statement ------------------------------------------------------------------------------------------------


def everything() -> cpcal.Network:
    """Every form that can be stated."""
    net = cpcal.Network()
    x, y = net.variable("x", 3, (-2.0, 2.0)), net.variable("y", (), (0.5, 2.0))
    net.add(cpcal.norm(x) <= 3.0)
    net.add(2.0 * cpcal.norm(x - 1.0) + y <= 7.0)
    net.add(y - 0.5 * cpcal.norm(x + 1.0) <= 0.25)
    net.add((cpcal.norm(x) - x[0] * y).within((-2.0, x[1] + 3.0)))
    net.add((x**3).sum() >= -(y**2))
    net.add(x[0] * x[1] * x[2] / 4.0 <= 1.0)
    net.add(cpcal.sqr(cpcal.sqr(x)) <= 9.0)
    net.add((x[[2, 0]] - x[1]).within((np.array([-np.inf, -3.0]), np.inf)))
    net.add(-x >= -1.75)
    return net


def direct(v: np.ndarray[Any, Any]) -> list[float]:
    """The slack of every element, where there is a bound."""
    x, y = v[:3], v[3]
    size, one, less = (math.sqrt(sum((x + s) ** 2)) for s in (0.0, -1.0, 1.0))
    return [
        3.0 - size, 7.0 - 2 * one - y, 0.25 - y + 0.5 * less,
        min(size - x[0] * y + 2.0, x[1] + 3.0 - size + x[0] * y),
        sum(x**3) + y**2, 1.0 - x[0] * x[1] * x[2] / 4.0, *(9.0 - x**4), np.inf, 3.0 + x[0] - x[1], *(1.75 - x),
    ]  # fmt: skip


def test_the_statement_means_what_the_network_means() -> None:
    statement, rng = network_statement(everything(), None, "everything"), np.random.default_rng(0)
    problem = statement.problem
    assert problem.count == 14
    seen = [set() for _ in range(problem.count)]  # type: ignore[var-annotated]
    for _ in range(400):
        v = rng.uniform([-2, -2, -2, 0.5], 2)
        for k, slack in enumerate(direct(v)):
            if abs(slack) > 1e-9:
                at = at_point(v.tolist())
                assert (holding(problem, at, k) is not None) == (slack > 0), (k, slack)
                assert (failing(problem, at, k) is not None) == (slack < 0)
                seen[k].add(slack > 0)
    assert sum(len(s) == 2 for s in seen) >= 10


def readings(net: cpcal.Network, x: cpcal.Expr) -> cpcal.Expr:
    return x * net.reading(np.array(1.0), np.array(0.5))


IMPOSSIBLE = {
    "readings": readings,
    "an interval": lambda net, x: x + net.constant(cpcal.Interval(0.25, 0.5)),
    "division by 3": lambda net, x: x / 3.0,
    "a maximum": lambda net, x: cpcal.maximum(x, 0.5),
    "division by what may be zero": lambda net, x: 1.0 / (x + 0.5),
    "two roots": lambda net, x: cpcal.sqrt(x + 2.0) + cpcal.sqrt(x + 3.0),
    "a root in a root": lambda net, x: cpcal.sqrt(cpcal.sqrt(x + 2.0) + 1.0),
    "a root times an unknown": lambda net, x: x * cpcal.sqrt(x + 2.0),
    "a negative power of what may be zero": lambda net, x: (x + 0.5) ** -2,
}


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_what_cannot_be_certified_is_refused_before_any_search(what, tmp_path, monkeypatch):
    net = cpcal.Network()
    x, t = net.variable("x", (), (-1.0, 1.0)), net.variable("t", (), (-10.0, 10.0))
    net.add(IMPOSSIBLE[what](net, x) <= t)

    def searched(*_: Any, **__: Any) -> None:
        raise AssertionError("a search was begun")

    monkeypatch.setattr("cpcal.solver.model.minimize", searched)
    with pytest.raises(cpcal.ModelError, match="constraint 0 cannot be certified"):
        net.minimize(t, certificate=tmp_path / "none.cert.jsonl")
    assert not list(tmp_path.iterdir())
    with pytest.raises(AssertionError, match="was begun"):
        net.minimize(t)


def test_a_division_by_an_expression_of_one_sign_is_certified_as_a_product(tmp_path: Path) -> None:
    net = cpcal.Network()
    x, t = net.variable("x", (), (-1.0, 1.0)), net.variable("t", (), (-10.0, 10.0))
    net.add(1.0 / (x + 3.0) <= t)
    net.minimize(t, certificate=tmp_path / "t.cert.jsonl")
    claims = check(tmp_path / "t.cert.jsonl").claims
    assert claims.eps_lo is not None
    assert F(1, 4) - F(1, 10**9) < claims.eps_lo <= F(1, 4)


def test_contractors_without_weights_certify_nothing(tmp_path: Path) -> None:
    net, eps = anchors()
    with pytest.raises(cpcal.ModelError, match="no weights"):
        net.minimize(eps, contractors=("hc4",), certificate=tmp_path / "none.cert.jsonl")
    assert not list(tmp_path.iterdir())


# real data ----------------------------------------------------------------------------------------------------------
