"""A paving that is stopped anywhere and gone on with ends in the answer that it would have had."""

import pytest

import cpcal
from cpcal.solver import model
from cpcal.solver.contract import Limits


def ring(least: float = 1.0) -> cpcal.Network:
    """A region, of one method."""
    net = cpcal.Network()
    y = net.variable("y", 2, (-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((least, 2.0)))
    return net


def points() -> cpcal.Network:
    """Single points, for which several methods take turns."""
    net = cpcal.Network()
    x, y, z = (net.variable(name, (), (-30, 30)) for name in "xyz")
    net.add(x**2 + y**2 + z**2 == 12.0)
    net.add(x * y + y * z == cpcal.sin(x) + 3.0)
    net.add(x**3 - z * y == 1.0)
    return net


def answer(paving: cpcal.Paving) -> tuple[object, ...]:
    boxes = [(s.verdict, s.box.lo.tolist(), s.box.hi.tolist()) for s in paving.solutions]
    inside = [(b.lo.tolist(), b.hi.tolist()) for b in paving.inside]
    outside = [(b.lo.tolist(), b.hi.tolist()) for b in paving.outside]
    return paving.complete, paving.nodes, paving.status, paving.method, boxes, inside, outside


@pytest.mark.parametrize(
    ("build", "options", "step"),
    [(ring, {"width": 0.2, "inner": True}, 80), (ring, {"width": 0.2, "order": "breadth"}, 90), (points, {}, 10)],
)
def test_stopped_again_and_again_it_ends_in_the_same_answer(build, options, step, tmp_path, monkeypatch):
    monkeypatch.setattr(model, "_SLICES", (8, 8))  # short turns, so that several methods have some
    whole = answer(build().solve(**options))
    file, stops = tmp_path / "search", 0
    while True:
        found = build().solve(**options, limits=Limits(nodes=step), checkpoint=file, resume=True)
        if not file.exists():
            break
        assert not found.complete
        stops += 1
    assert stops >= 2
    assert answer(found) == whole


def test_with_workers_the_answer_is_the_same(tmp_path):
    file = tmp_path / "search"
    ring().solve(width=0.2, inner=True, limits=Limits(nodes=80), checkpoint=file)
    on = ring().solve(width=0.2, inner=True, checkpoint=file, resume=True, workers=2)
    assert answer(on) == answer(ring().solve(width=0.2, inner=True))
