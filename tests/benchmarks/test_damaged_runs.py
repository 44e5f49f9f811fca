"""Files damaged at random are refused with a sentence, or mean what they say: some mutations of each kind of file."""

import random
from dataclasses import replace
from functools import partial

import pytest

from benchmarks import damaged_runs
from benchmarks.damaged_runs import BAD, MUTATIONS, RUNS, SUBJECTS, Subject, mutated, outcomes
from tests.remembered import verify_once

SLOW = ("hand-eye", "uncertain hand-eye", "wrong images")  # more than a second each


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] if name in SLOW else []) for name in SUBJECTS]
)
def test_no_mutation_ends_in_a_traceback_or_is_accepted_with_other_claims(name, tmp_path, monkeypatch, genuine_run):
    verify_once(monkeypatch)
    subject = SUBJECTS[name]
    if name in RUNS:
        subject = replace(subject, write=partial(genuine_run, name))
    count = 8 if name in RUNS else 60  # `make nightly` does 10,000
    found = list(outcomes(subject, tmp_path, count, seed=2027))
    assert [o for o in found if o.kind in BAD] == []
    assert len(found) == count
    assert sum(o.kind == "refused" for o in found) > count / 3


def test_a_costly_reader_is_found_out(tmp_path, monkeypatch):
    monkeypatch.setattr(damaged_runs, "SECONDS", 0.0)
    (found,) = outcomes(SUBJECTS["target"], tmp_path, 1, seed=1, apart=True)
    assert (found.kind, found.seconds > 0.0, found.megabytes > 10.0) == ("COSTLY", True, True)


@pytest.mark.parametrize("kind", ["CHANGED", "TRACEBACK"])
def test_a_careless_reader_is_found_out(kind, tmp_path):
    """The survey can fail: a reader that takes everything, or that raises what nobody expects."""

    def careless(folder):
        text = next(folder.glob("target.toml")).read_bytes()
        return text if kind == "CHANGED" else text.decode()

    subject = Subject("careless", SUBJECTS["target"].write, careless, lambda good, found: None)
    assert kind in {o.kind for o in outcomes(subject, tmp_path, 50, seed=1)}


def test_mutations_are_seeded_and_change_something():
    data = b'a = [1.5, -2e3]\nname = "x"\n'
    for k in range(200):
        assert mutated(random.Random(k), data) == mutated(random.Random(k), data)
        assert mutated(random.Random(k), data)[1] != data
    seen = {name for k in range(200) for name in mutated(random.Random(k), data)[0].split(" + ")}
    assert seen == set(MUTATIONS)
