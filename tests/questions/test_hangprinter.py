"""Real data, a user-defined constraint set: the anchors of a Hangprinter (DESIGN section 9)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cpcal import Limits, Network, Verdict, norm

SAMPLES = Path(__file__).resolve().parents[3] / "shared" / "data" / "hangprinter" / "samples.csv"
LINEAR = (2.318231, 2.211257, 2.752856, 3.192902)
QUADRATIC = (1.649541, 1.481699, 2.265669, 2.345835)

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not SAMPLES.exists(), reason=f"the Hangprinter's measurements are not at {SAMPLES}"),
]


def cable(samples: np.ndarray[tuple[int, int], np.dtype[np.float64]], number: int, quadratic: bool) -> Network:
    """|distance to the anchor - cable length by the motor| <= eps for every sample, anchor within +-4 m."""
    net = Network()
    anchor, length = net.variable("anchor", 3, (-4000, 4000)), net.variable("length", (), (0, 8000))
    turn, eps = net.variable("turn", (), (-1, 1)), net.variable("eps", (), (0, 1e4))
    angle = samples[:, 3 + number]
    out = length + turn * angle
    if quadratic:
        out = out + net.variable("spool", (), (-1e-5, 1e-5)) * angle**2
    net.add([(norm(samples[:, :3] - anchor) - out).within((-eps, eps)), out >= eps])
    return net


@pytest.mark.parametrize("quadratic", [False, True], ids=["linear", "quadratic"])
@pytest.mark.parametrize("number", range(4))
def test_smallest_model_error_of_every_cable(number: int, quadratic: bool) -> None:
    samples = np.genfromtxt(SAMPLES, delimiter=",", skip_header=1)
    net = cable(samples, number, quadratic)
    eps = next(v for v in net.variables if v.name == "eps")
    found = net.minimize(eps, limits=Limits(nodes=200))  # how many it takes depends on the processor
    expected = (QUADRATIC if quadratic else LINEAR)[number]
    assert found.verdict is Verdict.PROVED
    assert found.lo == pytest.approx(expected, rel=1e-6)
    assert found.hi == pytest.approx(expected, rel=1e-6)
    assert found.hi - found.lo <= 1e-6 * found.hi
    assert found.witness is not None
    anchor = found.witness.point[:3]
    assert (np.abs(anchor) <= 4000).all()
