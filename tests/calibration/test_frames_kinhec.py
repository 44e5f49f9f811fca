"""Frames on KinHEC's generated sequences (A. Aiersilan, PyPI package kinhec 1.1): its noise track, medium tier.

Twenty of the 1,200 sequences, one for each of the track's four robot and five camera noise levels, robots, camera
mountings and trajectories in turn. `python -m benchmarks.hand_eye` has the figures of a larger sample.
"""

import numpy as np
import pytest

pytest.importorskip("kinhec", reason="kinhec is not installed (pip install kinhec)")

from kinhec import solvers

from benchmarks.hand_eye import compared, errors, noise_track

ROBOTS, MOUNTINGS, TRAJECTORIES, LEVELS, REPEATS = 5, 2, 2, 20, 3


def number(level):
    """Of a sequence in the plan, whose order is robots, mountings, trajectories, levels, repeats."""
    robot = (level + level // 5) % ROBOTS
    place = (robot * MOUNTINGS + level // 2 % MOUNTINGS) * TRAJECTORIES + level % TRAJECTORIES
    return (place * LEVELS + level) * REPEATS


@pytest.fixture(scope="module")
def sequences():
    return list(noise_track("medium", [number(level) for level in range(LEVELS)]))


@pytest.mark.parametrize("refine", [False, True])
def test_the_median_error_of_shahs_method_is_below_a_millimetre(sequences, refine):
    assert np.median([errors(sequence, "shah", refine)[0] for sequence in sequences]) <= 1.0


def test_shahs_method_gives_the_figures_of_kinhecs_own_solver(sequences):
    for sequence in sequences:
        frames = sequence.key_frames()
        reference = compared(solvers.shah(frames.a, frames.b)[0], sequence)
        assert errors(frames, "shah", False) == pytest.approx(reference, abs=1e-5)
