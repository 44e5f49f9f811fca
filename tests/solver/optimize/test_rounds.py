"""Rounds of a search, decided by others: the same answer, certificate and order as here, whoever does the work."""

from concurrent.futures import ThreadPoolExecutor

import pytest

import cpcal


@pytest.fixture(scope="module")
def problem():
    """A minimum among many, so that more than sixteen boxes wait."""
    net = cpcal.Network()
    x, t = net.variable("x", shape=5, domain=(-2, 2)), net.variable("t", domain=(-50, 50))
    twisted = sum((x[k] * x[k + 1] - 0.3 * k) * (x[k] * x[k + 1] - 0.3 * k) + 0.1 * x[k] for k in range(4))
    net.add(twisted + x[4] * x[0] <= t)
    return net, t


@pytest.fixture(scope="module")
def paved():
    net = cpcal.Network()
    y = net.variable("y", shape=2, domain=(-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((1, 2)))
    net.add((y[0] * y[1]).within((0.1, 0.5)))
    return net


def minimised(problem, path, **place):
    net, t = problem
    seen, limits = [], cpcal.Limits(nodes=24)
    found = net.minimize(
        t, limits=limits, certificate=path, progress=lambda b: seen.append((b.lo, b.hi, b.nodes)), **place
    )
    return (found.lo, found.hi, found.nodes, found.programs, found.pending), seen, path.read_bytes()


def test_a_minimum_is_the_same_with_workers_and_with_threads(problem, tmp_path):
    here = minimised(problem, tmp_path / "here")
    assert any(later[2] - earlier[2] > 1 for earlier, later in zip(here[1], here[1][1:], strict=False))  # rounds
    assert minimised(problem, tmp_path / "there", workers=2) == here
    with ThreadPoolExecutor(3) as threads:
        assert minimised(problem, tmp_path / "threads", executor=threads) == here


def test_a_paving_is_the_same_with_workers(paved):
    def solved(**place):
        found = paved.solve(width=0.2, inner=True, **place)
        return found.nodes, found.inside, found.outside, [(s.verdict, s.box, s.cluster) for s in found.solutions]

    here = solved()
    assert solved(workers=2) == here
    with ThreadPoolExecutor(3) as threads:
        assert solved(executor=threads) == here


def test_one_leg_uses_all_workers_and_its_certificate_is_the_same(tmp_path):
    campaign = cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)

    def certified(name, **place):
        options = {"legs": [6], "delta": 200.0, "support": "none", "node_limit": 24, **place}
        found = cpcal.certify(campaign, certificates=tmp_path / name, **options)
        return found.legs[0].work.nodes, (tmp_path / name / "leg6.cert.jsonl").read_bytes()

    with Counting(2) as threads:
        assert certified("there", executor=threads) == certified("here")
        assert threads.count > 2


class Counting(ThreadPoolExecutor):
    """Counts its tasks."""

    count = 0

    def submit(self, *given, **named):
        self.count += 1
        return super().submit(*given, **named)
