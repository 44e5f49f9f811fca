"""A process that is asked to stop: a signal is a note that work looks at, never an exception in its midst."""

import os
import pickle
import signal
import threading
from fractions import Fraction as F

import pytest

import cpcal
from cpcal.checker import check
from cpcal.files.folders import save_campaign_json
from cpcal.questions.ask import answered
from cpcal.questions.question import question_of
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
        return answered(question_of(campaign, delta=0.5, legs=[1, 2])._replace(certificates=folder)), count


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
