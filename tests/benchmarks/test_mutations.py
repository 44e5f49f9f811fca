"""Files damaged at random are refused with a sentence, or mean what they say: 500 mutations of each kind of file."""

import random
import sys

import pytest

from benchmarks.mutants import MUTATIONS, mutated
from benchmarks.mutation_subjects import SUBJECTS, Subject
from benchmarks.mutations import BAD, outcomes
from cpcal.checker import check, check_run
from tests.remembered import remembered

COUNT = 500


@pytest.mark.parametrize("name", SUBJECTS)
def test_no_mutation_ends_in_a_traceback_or_is_accepted_with_other_claims(name, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[check_run.__module__], "check", remembered(check))
    found = list(outcomes(SUBJECTS[name], tmp_path, COUNT, seed=2026))
    assert [o for o in found if o.kind in BAD] == []
    assert len(found) == COUNT
    assert sum(o.kind == "refused" for o in found) > COUNT / 3


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
