"""What is stopped anywhere and gone on with ends in the answer and the certificate it would have had."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import cpcal
from cpcal.common.errors import InputError
from cpcal.solver import model
from cpcal.solver.contract import Limits
from cpcal.solver.optimize.bound import Minimum
from tests.networks import network

LIFTED = {"gap": 3e-2}  # with a certificate
HC4 = {"gap": 0.3, "contractors": ["hc4"]}


def solved(**options: object) -> Minimum:
    """Several boxes have to be divided."""
    limits = Limits(gap=options.pop("gap"), nodes=options.pop("nodes", None))
    net, x, y = network(x=(-2.0, 2.0), y=(-2.0, 2.0))
    net.add(x * x + y * y >= options.pop("least", 0.5))
    return net.minimize(x**4 - 2.0 * x * x + y**4 - y * y + 0.3 * x * y, limits=limits, **options)


def answer(found: Minimum) -> tuple[object, ...]:
    point = None if found.witness is None else found.witness.point.tolist()
    box = found.enclosure
    return found.lo, found.hi, point, box.lo.tolist(), box.hi.tolist(), found.nodes, found.programs, found.status


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[object, ...], bytes]:
    """The answer and the certificate of a minimisation that nobody stops."""
    path = tmp_path_factory.mktemp("whole") / "proof"
    return answer(solved(**LIFTED, certificate=path)), path.read_bytes()


@pytest.mark.parametrize(("options", "step"), [(LIFTED, 40), (HC4, 120)])
def test_stopped_again_and_again_it_ends_in_the_same_answer(options, step, tmp_path, whole):
    proof = tmp_path / "part" if options is LIFTED else None
    file, stops = tmp_path / "search", 0
    while True:
        found = solved(**options, nodes=step, certificate=proof, checkpoint=file, resume=True)
        if not file.exists():
            break
        assert found.pending
        stops += 1
    assert stops >= 2
    if proof is None:
        assert answer(found) == answer(solved(**options))
    else:
        assert (answer(found), proof.read_bytes()) == whole


def test_a_checkpoint_is_of_one_problem_its_options_and_its_certificate(tmp_path: Path) -> None:
    file = tmp_path / "search"
    part = solved(**HC4, nodes=50, checkpoint=file)
    with pytest.raises(InputError, match="problem differ"):
        solved(**HC4, least=0.6, checkpoint=file, resume=True)
    for other in ({"relax": 1e-8}, {"start": [1.0, 1.0]}, {"gap": 0.2}, {"contractors": ["lifted"]}):
        with pytest.raises(InputError, match="options differ"):
            solved(**{**HC4, **other}, checkpoint=file, resume=True)
    with pytest.raises(InputError, match="options differ"):
        solved(**LIFTED, certificate=tmp_path / "proof", checkpoint=file, resume=True)
    assert solved(**HC4, nodes=50, checkpoint=file).nodes == part.nodes  # without resume it begins anew


def test_killed_at_any_moment_it_goes_on_to_the_same_certificate(tmp_path, whole):
    script = tmp_path / "run.py"
    script.write_text(
        "import sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from cpcal.solver.execution import checkpoint_file\n"
        "checkpoint_file._EVERY = checkpoint_file._SHARE = 0.0\n"
        "import test_checkpoints as t\n"
        "t.solved(**t.LIFTED, certificate='part', checkpoint='search', resume=True)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], cwd=tmp_path) as run:
        while not (tmp_path / "search").exists() and run.poll() is None:
            time.sleep(0.001)
        assert run.poll() is None
        run.send_signal(signal.SIGKILL)
    found = solved(**LIFTED, certificate=tmp_path / "part", checkpoint=tmp_path / "search", resume=True)
    assert (answer(found), (tmp_path / "part").read_bytes()) == whole


def ring(least: float = 1.0) -> cpcal.Network:
    """A region, of one method."""
    net, y = network(2, y=(-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((least, 2.0)))
    return net


def points() -> cpcal.Network:
    """Single points, for which several methods take turns."""
    net, x, y, z = network(x=(-30, 30), y=(-30, 30), z=(-30, 30))
    net.add(x**2 + y**2 + z**2 == 12.0)
    net.add(x * y + y * z == cpcal.sin(x) + 3.0)
    net.add(x**3 - z * y == 1.0)
    return net


def answer_of(paving: cpcal.Paving) -> tuple[object, ...]:
    boxes = [(s.verdict, s.box.lo.tolist(), s.box.hi.tolist()) for s in paving.solutions]
    inside = [(b.lo.tolist(), b.hi.tolist()) for b in paving.inside]
    outside = [(b.lo.tolist(), b.hi.tolist()) for b in paving.outside]
    return paving.complete, paving.nodes, paving.status, paving.method, boxes, inside, outside


@pytest.mark.parametrize(
    ("build", "options", "step"),
    [(ring, {"width": 0.2, "inner": True}, 80), (ring, {"width": 0.2, "order": "breadth"}, 90), (points, {}, 10)],
)
def test_a_paving_stopped_again_and_again_ends_in_the_same_answer(build, options, step, tmp_path, monkeypatch):
    monkeypatch.setattr(model, "_SLICES", (8, 8))  # short turns, so that several methods have some
    whole = answer_of(build().solve(**options))
    file, stops = tmp_path / "search", 0
    while True:
        found = build().solve(**options, limits=Limits(nodes=step), checkpoint=file, resume=True)
        if not file.exists():
            break
        assert not found.complete
        stops += 1
    assert stops >= 2
    assert answer_of(found) == whole


def test_with_workers_the_answer_is_the_same(tmp_path):
    file = tmp_path / "search"
    ring().solve(width=0.2, inner=True, limits=Limits(nodes=80), checkpoint=file)
    on = ring().solve(width=0.2, inner=True, checkpoint=file, resume=True, workers=2)
    assert answer_of(on) == answer_of(ring().solve(width=0.2, inner=True))
