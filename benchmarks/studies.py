"""Certified answers beside the truth of simulated studies; each prints a row a case, and counts.

    python -m benchmarks.studies accuracy [--poses 100] [--studies 10]
    python -m benchmarks.studies outliers [--campaigns 50] [--outliers 1,2,3]
    python -m benchmarks.studies mistakes [--clean 100] [--wrong 3]

accuracy: DeltaLab platforms (true parameters off by 1 mm, 64 extremal poses, 11 runs each, the paper's noise), seen in
the true base frame; reading sets are three standard deviations of the means. Stated as the model error of each leg is
the least number that is TRUE: the largest error of some parameters over the calibration poses (for readings in their
sets), over 200 random poses of the stroke and over those asked about. So no bound may be violated. The ratio is the
largest bound over the largest true error. At last a study whose assumption fails: exact readings, calibrated in the
middle of the stroke, with the least error THERE stated.

outliers: campaigns of 64 extremal poses (joint error 0.1 mm, a tenth of the paper's noise, sets of three standard
deviations); q readings of leg 1, drawn at random, are off by 1 to 10 mm. A case counts as found when exactly these are
left out, as proved when the bracket is closed and the checker accepts the claim.

mistakes: what `check` says of campaigns as they should be (the robots of the catalogue; 12 to 200 measurements,
extremal and random poses; drawings off by up to 10 mm, model errors up to 1 mm, a twentieth of both for the small
hexapod; the paper's noise), and of DeltaLab campaigns with each of the mistakes of `wrong_ways` (drawings off by 1, 2,
... mm). A mistake counts as named when the first sentence has its name.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import cpcal
from benchmarks.wrong_ways import WRONG_WAYS
from cpcal.calibration import averaged
from cpcal.checker import check_run
from cpcal.models import fit_model
from cpcal.models.leg_set import AskedSet, certified_set
from cpcal.models.platform import pose_bounds
from cpcal.questions.accuracy import distances, error_network, exactly, joined_campaign, least_error
from cpcal.questions.points import verified_rows
from cpcal.robot import ROBOTS, Pose, Robot, forward_kinematics
from cpcal.robot.mistakes import spread_of, suspicions
from cpcal.simulate import simulate, simulate_study
from cpcal.simulate.campaigns import STROKE
from cpcal.simulate.studies import true_poses
from cpcal.solver.interval import get_arithmetic

STUDIES: tuple[dict[str, float], ...] = (
    {},
    {"seed": 2},
    {"joint_error": 0.2},
    {"joint_error": 1.0},
    {"sag": 1.0},
    {"gain": 0.002},
    {"axis_offset": 3.0},
    {"joint_offset": 1.0},
    {"sag": 3.0, "seed": 2},
    {"joint_error": 0.5, "seed": 3},
)
_OTHERS = 200  # random poses that decide the true model error, besides


def accuracy(asked: argparse.Namespace) -> None:
    """Bounds of poses that nobody measured."""
    print("study, controller: model error [mm]; outside; bound, true [mm]; ratio")
    found = [ratio for options in STUDIES[: asked.studies] for ratio in _bounded(options, asked.poses)]
    for k, controller in enumerate(("fit", "nominal")):
        print(f"{controller}: ratios median {np.median(found[k::2]):.2f}, largest {max(found[k::2]):.2f}")
    print("calibrated in the middle of the stroke alone:")
    _bounded({"joint_error": 1.0}, asked.poses, inner=True)


def _bounded(options: dict[str, float], count: int, *, inner: bool = False) -> list[float]:
    """The ratio for each controller. `inner`: calibrated exactly in the middle of the stroke, whose error is stated."""
    more: dict[str, object] = {"stroke": (55.0, 85.0), "noise": 0.0} if inner else {}
    settings = {"seed": 1, **options, **more}
    study = simulate_study(runs=11, validation_runs=1, random_poses=1, truncate=3.0, **settings)  # type: ignore[arg-type]
    truth, table = study.truth, study.calibration
    assert truth is not None
    seen = truth.mobile_in_base(table)
    arrays = (study.robot, seen.position, seen.quaternion, table.length)
    campaign = averaged(cpcal.Campaign.of(*arrays, pose=table.pose, run=table.run, exact=True), of="mean")
    campaign = exactly(campaign) if inner else campaign
    stream = np.random.default_rng(7)
    readings = stream.uniform(*STROKE, (count + _OTHERS, 6))
    true = true_poses(truth, readings, STROKE, 1, stream)
    others = exactly(cpcal.Campaign.of(study.robot, true.position, true.quaternion, readings, exact=True))
    known = campaign if inner else others
    fitted = np.stack([fit_model(campaign, leg) for leg in range(1, 7)])
    errors = [_true_error(campaign, known, leg) for leg in range(1, 7)]
    out = []
    for controller, parameters in (("fit", fitted), ("nominal", study.robot.parameters)):
        center = dict(zip(range(6), zip(errors, fitted, parameters, strict=True), strict=True))
        found = [
            certified_set(AskedSet(campaign, k + 1, e, center=x, delta=50.0, controller=p))
            for k, (e, x, p) in center.items()
        ]
        sets = [one for one in found if one is not None]
        assert len(sets) == 6, "a true model error was refuted"
        here = Pose(true.position[:count], true.quaternion[:count])
        commanded = forward_kinematics(Robot.from_parameters("controller", parameters), readings[:count], here)
        bounds = pose_bounds(commanded, sets)
        position, angle = distances(here, commanded)
        outside = int(np.sum((position > bounds.position) | (angle > bounds.rotation)))
        out.append(float(bounds.position.max() / position.max()))
        sizes = f"{bounds.position.max():.3f}, {position.max():.3f}; {out[-1]:.2f}"
        error = f"{min(errors):.3f} to {max(errors):.3f}"
        print(f"{options or 'perfect'}, {controller}: {error}; {outside} of {count}; {sizes}", flush=True)
    return out


def _true_error(campaign: cpcal.Campaign, others: cpcal.Campaign, leg: int) -> float:
    """mm: with it some parameters satisfy the leg's equation at all poses of `others` and, for readings in their sets,
    of the campaign."""
    start = fit_model(campaign, leg)
    network = error_network(joined_campaign([campaign, others]), leg, start.tolist(), 50.0)
    x, error = least_error(network, start.tolist())
    engine = get_arithmetic("float64")
    while verified_rows(campaign, leg, x, error, engine)[1] or verified_rows(others, leg, x, error, engine)[1]:
        error = 1.0001 * error + 1e-7
    return error


def outliers(asked: argparse.Namespace) -> None:
    """Wrong measurements, found and proved."""
    print(" q found proved   of  median: certificates  kB  seconds (largest)")
    for q in map(int, asked.outliers.split(",")):
        found = proved = 0
        figures = []
        for seed in range(1, 1 + asked.campaigns):
            good = simulate(seed=seed, joint_error=0.1, noise=0.1, truncate=3.0)
            rng = np.random.default_rng([seed, q])
            wrong = rng.choice(len(good), q, replace=False)
            length = good.length.copy()
            length[wrong, 0] += rng.choice([-1.0, 1.0], q) * rng.uniform(1.0, 10.0, q)
            arrays = (good.robot, good.position, good.quaternion, length)
            campaign = cpcal.Campaign.of(*arrays, pose=good.pose, run=good.run, uncertainty=good.uncertainty)
            with tempfile.TemporaryDirectory() as name:
                began = time.process_time()
                (leg,) = cpcal.certify(campaign, outliers=q, legs=(1,), certificates=name).legs
                seconds = time.process_time() - began
                (checked,) = check_run(Path(name))
                size = sum(path.stat().st_size for path in Path(name).glob("*.cert.jsonl"))
            found += set(leg.bracket.left_out) == {campaign.measurement_ids[k] for k in wrong}
            of = checked.robust
            proved += of is not None and checked.refused is None and of.lo is not None and of.hi is not None
            figures.append((len(leg.bracket.proofs), size / 1000.0, seconds))
        files, kilobytes, cpu = np.median(np.array(figures), axis=0)
        worst = max(row[2] for row in figures)
        print(f"{q:2} {found:5} {proved:6} {asked.campaigns:4} {files:21.0f} {kilobytes:4.0f} {cpu:8.1f} ({worst:.1f})")


def mistakes(asked: argparse.Namespace) -> None:
    """Clean campaigns that are named, and mistakes that are not."""
    named, most, seconds = 0, 0.0, 0.0
    for seed in range(asked.clean):
        campaign = clean(seed)
        began = time.process_time()
        said = suspicions(campaign)
        seconds = max(seconds, time.process_time() - began)
        named += bool(said)
        ratio = spread_of(campaign).ratio
        most = max(most, 0.0 if ratio is None else float(ratio.max()))
        print(*(f"clean campaign {seed}, {campaign.robot.name}: {sentence}" for sentence in said), sep="\n", end="")
    print(
        f"{named} of {asked.clean} clean campaigns named; residuals up to {most:.1f} times the stated; {seconds:.1f} s"
    )
    right, of, seconds = 0, 0, 0.0
    for seed in range(1, 1 + asked.wrong):
        campaign = simulate(seed=seed, deviation=float(seed), joint_error=0.1, random_poses=20 * (seed % 2))
        for way, (wrong, name) in WRONG_WAYS.items():
            if way in UNNAMED:
                continue
            began = time.process_time()
            said = suspicions(wrong(campaign))
            seconds = max(seconds, time.process_time() - began)
            good = bool(said) and name in said[0]
            right, of = right + good, of + 1
            if not good:
                print(f"{way}, drawing off by {seed} mm: {said}")
    print(f"{right} of {of} mistakes named ({len(WRONG_WAYS) - len(UNNAMED)} kinds); {seconds:.1f} s at most")


UNNAMED = ("duplicate rows", "one outlier", "one wrong pose", "constant pose")  # `check` finds them otherwise


def clean(seed: int) -> cpcal.Campaign:
    """A campaign as it should be: every other one of the DeltaLab platform."""
    rng = np.random.default_rng(seed)
    known = list(ROBOTS.values())[(seed // 2) % len(ROBOTS) if seed % 2 else 0]
    count, small = int(rng.integers(12, 201)), 0.05 if known.robot.name.startswith("Rubin") else 1.0
    extremal = bool(seed % 3) and count > 64 and known.workspace is None
    options: dict[str, Any] = {
        "deviation": small * rng.uniform(0.0, 10.0),
        "joint_error": small * (0.0, 0.1, 0.3, 1.0)[seed % 4],
    }
    options |= {"workspace": known.workspace} if known.workspace else {"stroke": known.stroke}
    number = count - 64 * extremal
    return simulate(known.robot, seed=seed, random_poses=number, extremal=extremal, **options)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    studies = parser.add_subparsers(dest="study", required=True)
    options: dict[str, dict[str, Any]] = {
        "accuracy": {"poses": 100, "studies": len(STUDIES)},
        "outliers": {"campaigns": 50, "outliers": "1,2,3"},
        "mistakes": {"clean": 100, "wrong": 3},
    }
    for name, given in options.items():
        study = studies.add_parser(name)
        for option, default in given.items():
            study.add_argument(f"--{option}", type=type(default), default=default)
    asked = parser.parse_args()
    {"accuracy": accuracy, "outliers": outliers, "mistakes": mistakes}[asked.study](asked)


if __name__ == "__main__":
    main()
