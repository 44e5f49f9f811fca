"""With a certificate contractors that give no weights take no part: what they say reaches neither it nor the answer."""

import math
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from contractors import Lifted
from cpcal.checker import check
from cpcal.solver import plugins
from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box

SMALL: dict[str, Any] = {"seed": 1, "extremal": False, "random_poses": 16, "joint_error": 10.0}


class Oracle(Composable):
    """Knows something true that no weights prove: the objective is at least `least`."""

    def __init__(self, least: float, name: str) -> None:
        self.least, self.name = least, name

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        if box.is_empty or not box.lo[box.index(self.name)] < self.least:
            return Contraction(box)
        return Contraction(box.replace(self.name, lo=self.least), (Step("oracle", self.name, "lo", self.least),))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> tuple[cpcal.Campaign, Path]:
    folder = tmp_path_factory.mktemp("campaign")
    cpcal.save_campaign(cpcal.simulate(**SMALL, factor=0.0), folder)
    return cpcal.load_campaign(folder), folder


def test_what_weights_do_not_prove_in_time_is_not_the_answer(campaign, tmp_path, monkeypatch):
    """A bound of the leg that only one contractor knows is no answer: the one that the certificate proves is."""
    known = 0.9 * cpcal.certify(campaign[0], legs=[1], delta=2.0).legs[0].bracket.lo
    load = plugins.load

    def with_oracle(name: str) -> Any:
        return (lambda *_, **__: Oracle(known, "eps")) if name == "oracle" else load(name)

    monkeypatch.setattr(plugins, "load", with_oracle)
    monkeypatch.setattr(Lifted, "contract", lambda self, box, deadline=math.inf: Contraction(box))
    question: dict[str, Any] = {"legs": [1], "delta": 2.0, "certificates": tmp_path, "time_limit": 0.3}
    leg = cpcal.certify(campaign[0], contractors=("oracle", "lifted"), **question).legs[0]
    assert leg.bracket.lo == 0.0
    assert leg.bracket.certificate is not None
    claims = check(tmp_path / leg.bracket.certificate).claims
    assert claims.eps_lo == F(leg.bracket.lo)
    assert claims.eps_hi == F(leg.bracket.hi)


OPTIMUM = 4.25 / 19


def two_anchors() -> tuple[cpcal.Network, cpcal.Expr]:
    """Distances to three points on a line, which no point has: two mirrored optima."""
    net = cpcal.Network()
    p, z = net.variable("p", 2, (-20.0, 20.0)), net.variable("z", (), (0.0, 20.0))
    net.add((cpcal.norm(np.array([[-3.0, 0.0], [3.0, 0.0]]) - p) - np.array([5.0, 5.0])).within((-z, z)))
    net.add((cpcal.norm(np.zeros((1, 2)) - p) - 4.5).within((-z, z)))
    return net, z


def test_a_wrong_refutation_by_another_contractor_never_reaches_the_certificate(tmp_path: Path) -> None:
    """A contractor that lies is no reason for the certificate to lie."""

    class Liar(Composable):
        def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
            return Contraction(Box.empty(box.names), (Step("liar", None, "", np.nan),))

    net, z = two_anchors()
    found = net.minimize(
        z, contractors=[Liar(), "lifted"], limits=cpcal.Limits(gap=1e-3), certificate=tmp_path / "c.jsonl"
    )
    assert found.lo <= OPTIMUM <= found.hi
    assert found.verdict is cpcal.Verdict.PROVED
    assert not check(tmp_path / "c.jsonl").claims.infeasible
