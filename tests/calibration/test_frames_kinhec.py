"""Frames on KinHEC's generated sequences (A. Aiersilan, PyPI package kinhec 1.1): its noise track, medium tier.

Four of the 1,200 sequences (seven at night), at every fifth (third) of the track's twenty pairs of robot and camera
noise levels, robots, camera mountings and trajectories in turn. `python -m benchmarks.hand_eye` has the figures of a
larger sample.
"""

from dataclasses import replace

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


@pytest.fixture(scope="module", params=[5, pytest.param(3, marks=pytest.mark.nightly)])
def sequences(request):
    return list(noise_track("medium", [number(level) for level in range(0, LEVELS, request.param)]))


def test_the_median_error_of_shahs_method_refined_is_below_a_millimetre(sequences):
    assert np.median([errors(sequence, "shah", True)[0] for sequence in sequences]) <= 1.0


def test_refinement_by_axis_lessens_the_error_on_average(sequences):
    pairs = [[errors(sequence, "shah", refine)[0] for refine in (False, True)] for sequence in sequences]
    plain, refined = np.log(pairs).T
    assert np.mean(refined - plain) < 0.0


def test_shahs_method_gives_the_figures_of_kinhecs_own_solver(sequences):
    for sequence in sequences:
        reference = compared(solvers.shah(sequence.a, sequence.b)[0], sequence)
        same = replace(sequence, eye_in_hand=False)  # its own way to write a camera on the hand
        assert errors(same, "shah", False) == pytest.approx(reference, abs=1e-5)
