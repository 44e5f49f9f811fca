"""A minimisation that is stopped anywhere and gone on with ends in the answer and the certificate it would have had."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import cpcal
from cpcal.common.errors import InputError
from cpcal.solver.contract import Limits
from cpcal.solver.optimize.bound import Minimum

LIFTED = {"gap": 3e-2}  # with a certificate
HC4 = {"gap": 0.3, "contractors": ["hc4"]}


def hills(least: float = 0.5) -> tuple[cpcal.Network, cpcal.Expr]:
    """Several boxes have to be divided."""
    net = cpcal.Network()
    x, y = (net.variable(name, (), (-2.0, 2.0)) for name in "xy")
    net.add(x * x + y * y >= least)
    return net, x**4 - 2.0 * x * x + y**4 - y * y + 0.3 * x * y


def solved(**options: object) -> Minimum:
    limits = Limits(gap=options.pop("gap"), nodes=options.pop("nodes", None))
    net, objective = hills(options.pop("least", 0.5))
    return net.minimize(objective, limits=limits, **options)


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
        "import test_minimum_checkpoint as t\n"
        "t.solved(**t.LIFTED, certificate='part', checkpoint='search', resume=True)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], cwd=tmp_path) as run:
        while not (tmp_path / "search").exists() and run.poll() is None:
            time.sleep(0.001)
        assert run.poll() is None
        run.send_signal(signal.SIGKILL)
    found = solved(**LIFTED, certificate=tmp_path / "part", checkpoint=tmp_path / "search", resume=True)
    assert (answer(found), (tmp_path / "part").read_bytes()) == whole
