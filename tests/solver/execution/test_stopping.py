"""A signal is a note that work looks at; a checkpoint is read whole and of the same work, or refused."""

import gzip
import os
import pickle
import signal
import threading
from fractions import Fraction as F

import pytest

import cpcal
from cpcal.checker import check
from cpcal.common.errors import InputError
from cpcal.files.folders import save_campaign_json
from cpcal.questions.ask import answered
from cpcal.questions.question import question_of
from cpcal.solver.execution.checkpoint_file import read_checkpoint, write_checkpoint
from cpcal.solver.execution.stopping import Reason, Stopped, also_asked_by, asked, heard, raising


@pytest.fixture(autouse=True)
def _ctrl_c_raises():
    """Runners may start us with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_first_signal_is_a_note_and_the_second_does_what_it_always_did():
    with heard():
        assert asked() is None
        os.kill(os.getpid(), signal.SIGINT)
        assert asked() is Reason.INTERRUPTED
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert asked() is None
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_sigterm_is_heard_where_that_is_asked_for():
    before = signal.getsignal(signal.SIGTERM)
    with heard():
        assert signal.getsignal(signal.SIGTERM) is before
    with heard(terminate=True):
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked() is Reason.TERMINATED
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_signal_that_the_shell_ignores_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with heard():
        os.kill(os.getpid(), signal.SIGINT)
        assert asked() is None


def test_both_signals_raise_where_there_is_something_to_tidy_up():
    for name, reason in (("SIGINT", Reason.INTERRUPTED), ("SIGTERM", Reason.TERMINATED)):
        with pytest.raises(Stopped) as stop, raising():
            os.kill(os.getpid(), getattr(signal, name))
        assert stop.value.reason is reason


def test_a_stop_travels():
    again = pickle.loads(pickle.dumps(Stopped(Reason.TERMINATED)))
    assert (again.reason, str(again)) == (Reason.TERMINATED, "terminated")


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=12)


def stopped_after(campaign, looks, folder):
    """A certify that is asked to stop when it looks for the so-maniest time, and how often it looked."""
    count = 0

    def source():
        nonlocal count
        count += 1
        return Reason.INTERRUPTED if count > looks else None

    folder.mkdir()
    save_campaign_json(campaign, folder)
    with heard(), also_asked_by(source):
        return answered(question_of(campaign, delta=0.5, legs=[1, 2]), folder=folder), count


def test_whenever_it_is_asked_a_leg_that_is_answered_stays_and_has_its_certificate(campaign, tmp_path):
    (whole, count), numbers = stopped_after(campaign, 10**9, tmp_path / "whole"), set()
    for looks in range(0, count, max(count // 4, 1)):
        run = tmp_path / str(looks)
        part, _ = stopped_after(campaign, looks, run)
        assert part.interrupted or len(part.legs) == 2
        numbers.add(len(part.legs))
        for leg, complete in zip(part.legs, whole.legs, strict=False):
            assert leg.bracket.lo <= complete.bracket.lo
            assert leg.bracket.hi >= complete.bracket.hi
            assert leg.certified == (run / f"leg{leg.leg}.cert.jsonl").exists()
            if leg.certified:
                assert check(run / leg.bracket.certificate).claims.eps_lo == F(leg.bracket.lo)
    assert numbers == {0, 1, 2}


def test_a_thread_leaves_signals_alone():
    def run():
        with heard(terminate=True), raising():
            seen.append(signal.getsignal(signal.SIGINT))

    seen = []
    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


OF = {"campaign": "abc", "options": "def"}
LINES = [{"k": k, "value": (k / 7.0).hex()} for k in range(200)]


@pytest.fixture
def path(tmp_path):
    write_checkpoint(tmp_path / "folder" / "a", OF, LINES)
    return tmp_path / "folder" / "a"


def test_what_is_written_is_read(path):
    assert read_checkpoint(path, OF) == LINES


def test_wherever_it_is_cut_off_it_is_refused(path):
    whole = path.read_bytes()
    for size in [*range(0, len(whole), 37), len(whole) - 1]:
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="is cut off"):
            read_checkpoint(path, OF)


def test_a_line_less_or_changed_is_refused(path):
    text = gzip.decompress(path.read_bytes())
    lines = text.split(b"\n")
    for changed in (lines[:5] + lines[6:], [*lines[:7], lines[7].replace(b"1", b"2"), *lines[8:]], lines[:-2] + [b""]):
        assert changed != lines
        path.write_bytes(gzip.compress(b"\n".join(changed)))
        with pytest.raises(InputError, match="is cut off or garbled"):
            read_checkpoint(path, OF)


def test_one_of_other_work_is_refused_and_named(path):
    with pytest.raises(InputError, match="of another run: campaign differ"):
        read_checkpoint(path, OF | {"campaign": "xyz"})


def test_one_that_cannot_be_written_leaves_the_older_one(path):
    def lines():
        yield {"k": 1}
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left"):
        write_checkpoint(path, OF, lines())
    assert read_checkpoint(path, OF) == LINES
    assert [p.name for p in path.parent.iterdir()] == ["a"]
