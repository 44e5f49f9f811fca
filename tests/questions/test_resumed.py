"""A run that was stopped, gone on with: the same answers and certificates, byte for byte, as if nobody had come."""

import sys
from dataclasses import replace

import pytest

import cpcal
from cpcal.common.errors import InputError
from cpcal.solver.certificate.recording import SearchKeeper
from cpcal.solver.execution.checkpoint_file import FOLDER
from cpcal.solver.execution.stopping import Reason, also_asked_by, heard

OPTIONS = {"legs": [2, 3], "delta": 200.0}


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=1, joint_error=60.0, factor=0.0, extremal=False, random_poses=10)


@pytest.fixture(scope="module")
def whole(campaign, tmp_path_factory):
    run = tmp_path_factory.mktemp("whole")
    found = cpcal.certify(campaign, certificates=run, **OPTIONS)
    assert max(leg.work.nodes for leg in found.legs) > 1  # boxes are divided
    return found, certificates(run)


def certificates(run):
    return {path.name: path.read_bytes() for path in run.glob("*.cert.jsonl")}


def stopped(campaign, run, looks, **options):
    """A certify that is asked to stop when it looks for the so-maniest time."""
    left = iter(range(looks))
    source = lambda: None if next(left, None) is not None else Reason.INTERRUPTED  # noqa: E731
    with heard(), also_asked_by(source):
        return cpcal.certify(campaign, certificates=run, **OPTIONS, **options)


def same(one, two):
    """But for the time that it took."""
    a, b = ([replace(leg, work=replace(leg.work, seconds=0.0)) for leg in found.legs] for found in (one, two))
    assert a == b


@pytest.mark.parametrize("looks", [2, 5, 12])
def test_a_stopped_run_ends_as_an_undisturbed_one(campaign, whole, tmp_path, monkeypatch, looks):
    monkeypatch.setattr(sys.modules[SearchKeeper.__module__], "_LONG", 0.0)  # a stop may strike after a quick search
    part = stopped(campaign, tmp_path, looks)
    assert part.interrupted
    assert (tmp_path / FOLDER).is_dir() or not part.legs
    result = cpcal.certify(campaign, certificates=tmp_path, resume=True, **OPTIONS)
    same(result, whole[0])
    assert certificates(tmp_path) == whole[1]
    assert not (tmp_path / FOLDER).exists()


def test_a_limit_leaves_a_checkpoint_that_another_limit_goes_on_from(campaign, whole, tmp_path):
    part = cpcal.certify(campaign, certificates=tmp_path, node_limit=1, **OPTIONS)
    assert not part.interrupted
    assert sum(leg.work.pending for leg in part.legs) > 0
    assert all(leg.certified for leg in part.legs)
    result = cpcal.certify(campaign, certificates=tmp_path, resume=True, **OPTIONS)
    same(result, whole[0])
    assert certificates(tmp_path) == whole[1]


def test_a_checkpoint_of_other_work_is_refused(campaign, tmp_path):
    stopped(campaign, tmp_path, 4)
    other = cpcal.simulate(seed=2, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)
    before = certificates(tmp_path)
    with pytest.raises(InputError, match="of another run: campaign differ"):
        cpcal.certify(other, certificates=tmp_path, resume=True, **OPTIONS)
    with pytest.raises(InputError, match="options differ"):
        cpcal.certify(campaign, certificates=tmp_path, resume=True, **{**OPTIONS, "delta": 401.0})
    (part,) = (tmp_path / FOLDER).glob("*.search")
    part.write_bytes(part.read_bytes()[:-9])
    with pytest.raises(InputError, match="cut off"):
        cpcal.certify(campaign, certificates=tmp_path, resume=True, **OPTIONS)
    assert certificates(tmp_path) == before


def test_an_edited_user_defined_model_does_not_go_on_from_answers_of_the_old_one(campaign, tmp_path):
    def model(factor):
        extra = (cpcal.Parameter("s", "mm/mm", 0.05),)
        return cpcal.LegModel("mine", "a gain", extra, lambda measured, x: factor * measured.length * x["s"])

    def stop(leg, _):
        if leg == 2:
            raise KeyboardInterrupt

    first = {"model": model(1.0), "node_limit": 1, "delta": 5.0}
    begun = cpcal.certify(campaign, legs=[1, 2], certificates=tmp_path, progress=stop, **first)
    assert begun.interrupted
    assert begun.legs
    with pytest.raises(InputError, match="of another run: model differ"):
        cpcal.certify(campaign, certificates=tmp_path, resume=True, **{**first, "model": model(2.0)})
    cpcal.certify(campaign, certificates=tmp_path, resume=True, **first)  # the same function again
