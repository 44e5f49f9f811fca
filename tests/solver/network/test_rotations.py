"""Rotations in networks are those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cpcal
from cpcal.common.errors import ModelError
from cpcal.solver.network import mathematics


def value(function: object, point: np.ndarray) -> np.ndarray:
    """An expression of one array of unknowns at a point."""
    net = cpcal.Network()
    x = net.variable("x", len(point), (-10, 10))
    found = cpcal.evaluate(net, function(x), cpcal.Box(net.names, point, point))  # type: ignore[operator]
    assert float(np.max(found.hi - found.lo)) < 1e-12
    return np.asarray(found.mid)


@pytest.mark.parametrize("seed", range(5))
def test_matrices_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, v, angles = rng.standard_normal(4), rng.standard_normal(3), rng.uniform(-3, 3, 3)
    expected = Rotation.from_quat(np.roll(q, -1)).as_matrix()
    assert value(mathematics.rotation_from_quaternion, q) == pytest.approx(expected, abs=1e-12)
    assert value(mathematics.rotation_from_vector, v) == pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=1e-12)
    for sequence in ("xyz", "ZYX", "zxz", "YZY"):
        expected = Rotation.from_euler(sequence, angles).as_matrix()
        found = value(lambda x, s=sequence: mathematics.rotation_from_euler(s, x), angles)
        assert found == pytest.approx(expected, abs=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    with pytest.raises(ModelError, match="no sequence"):
        mathematics.rotation_from_euler("xYz", [0, 0, 0])
    with pytest.raises(ModelError, match="4 numbers"):
        mathematics.rotation_from_quaternion([1, 0, 0])


def test_the_turn_that_takes_one_vector_to_another_is_found() -> None:
    net = cpcal.Network()
    angle = net.variable("angle", domain=(0, 3))
    turned = mathematics.rotation_from_axis([0, 0, 1], angle) @ np.array([1.0, 0.0, 0.0])
    net.add(turned[1] == 0.5)
    assert sorted(s.box.mid[0] for s in net.solve().solutions) == pytest.approx([np.pi / 6, 5 * np.pi / 6], abs=1e-6)
