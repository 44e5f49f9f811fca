"""Certified answers beside the truth of simulated studies; each prints a row a case, and counts.

    python -m benchmarks.studies accuracy [--poses 100] [--seeds 2]
    python -m benchmarks.studies default [--campaigns 20] [--poses 100]
    python -m benchmarks.studies outliers [--campaigns 50] [--outliers 1,2,3]
    python -m benchmarks.studies tolerance [--campaigns 100]
    python -m benchmarks.studies verdicts [--campaigns 200]
    python -m benchmarks.studies mistakes [--clean 100] [--wrong 3]

The pages that state the figures say of what they are: docs/accuracy.md (accuracy, default, outliers), docs/trust.md
(tolerance, verdicts), docs/your-data.md (mistakes). What they leave to this file:

accuracy: bounds and U at random poses of the stroke. Stated as the model error of each leg is the least number that is
TRUE: the largest error of some parameters over the calibration poses (for readings in their sets), over 200 other poses
and over those asked about. So no bound may be violated. Ratios are of the largest to the largest true error.

outliers: a case counts as found when exactly the wrong readings are left out, as proved when the bracket is closed and
the checker accepts the claim.

verdicts: false is a pass though the recommended parameters err by more than T at a true pose that was measured, or a
fail though the true parameters do not.

mistakes: one counts as named when the first sentence has its name. Of the small hexapod a twentieth is off.
"""

import json
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import cpcal
from benchmarks import run_by_hand
from benchmarks.wrong_ways import WRONG_WAYS
from cpcal.calibration import averaged
from cpcal.checker import check_run
from cpcal.common.values import Floats
from cpcal.models import fit_model, leg_box, leg_network
from cpcal.models.leg_set import AskedSet, CertifiedSet, certified_set
from cpcal.models.platform import Cells, cell_bounds
from cpcal.questions.accuracy import FAR, distance_from_measured, expanded_uncertainty, suggested_error
from cpcal.questions.next_measurement import Polytope, attained
from cpcal.questions.points import certify_point
from cpcal.robot import (
    ROBOTS,
    Campaign,
    Pose,
    Robot,
    Uncertainty,
    compose,
    distances,
    forward_kinematics,
    inverse,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    small_rotation,
)
from cpcal.robot.campaign import ARRAYS
from cpcal.robot.mistakes import spread_of, suspicions
from cpcal.simulate import simulate, simulate_study
from cpcal.simulate.campaigns import STROKE, mechanisms_of, true_poses
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit as minimax_fit

KINDS: tuple[dict[str, float], ...] = (  # of mechanisms
    {"joint_error": 1.0}, {"joint_error": 0.2}, {"sag": 3.0}, {"sag": 1.0}, {"gain": 0.002}, {"gain": 0.005},
    {"axis_offset": 3.0}, {"axis_offset": 6.0}, {"axis_offset": 1.0}, {},
)  # fmt: skip
_OTHERS = 200  # random poses that decide the true model error, besides
_BUMP = 0.3  # mm: the error that vanishes at both ends of the stroke


def _studied(options: dict[str, float], count: int, more: int = 0) -> tuple[Campaign, Pose, Floats]:
    """A campaign of means, with `more` random poses, and `count` unseen true poses with their readings. "bump": mm, of
    the error that vanishes at both ends of the stroke."""
    bump, given = options.get("bump", 0.0), {name: value for name, value in options.items() if name != "bump"}
    settings: dict[str, Any] = {"runs": 11, "validation_runs": 11, "random_poses": max(more, 1), "truncate": 3.0}
    study = simulate_study(**settings | given)
    truth, parts = study.truth, list[Campaign]()
    assert truth is not None

    def bent(length: Floats) -> Floats:
        return length + bump * np.sin(np.pi * length / STROKE[1])

    for table in (study.calibration, study.validation)[: 1 + bool(more)]:
        seen = compose(compose(inverse(truth.camera), table.poses), inverse(truth.target))
        arrays = (study.robot, seen.position, seen.quaternion, bent(table.length))
        parts.append(averaged(Campaign.of(*arrays, pose=table.pose, run=table.run, exact=True), of="mean"))
    stream = np.random.default_rng(7)
    readings = stream.uniform(*STROKE, (count, 6))
    mechanisms = mechanisms_of(json.loads(study.provenance["options"]))
    return _joined(parts), true_poses(truth.robot, mechanisms, readings, STROKE, 1, stream), bent(readings)


def _sets(campaign: Campaign, errors: list[float], known: Floats) -> list[CertifiedSet]:
    asked = [AskedSet(campaign, k + 1, e, x, 50.0, x) for k, (e, x) in enumerate(zip(errors, known, strict=True))]
    sets = [one for one in map(certified_set, asked) if one is not None]
    assert len(sets) == 6, "a true model error was refuted"
    return sets


def accuracy(poses: int = 100, seeds: int = 2) -> None:
    """Bounds, and U, of poses that nobody measured."""
    print("study: model error [mm]; U holds at; U / truth; outside of the bound; bound / truth; bound / attained")
    rows = []
    for options in ({**kind, "seed": seed} for kind in KINDS for seed in range(1, 1 + seeds)):
        campaign, every, readings = _studied(options, poses + _OTHERS)
        others = Campaign.of(campaign.robot, every.position, every.quaternion, readings, exact=True)
        known, here = np.stack([fit_model(campaign, leg) for leg in range(1, 7)]), every.rows(np.arange(poses))
        robot = Robot.from_parameters("controller", known)
        commanded = forward_kinematics(robot, readings[:poses], here)
        (position, angle), u = distances(here, commanded), expanded_uncertainty(campaign, robot, commanded)
        errors = [_true_error(campaign, others, leg) for leg in range(1, 7)]
        sets = _sets(campaign, errors, known)
        found = cell_bounds(Cells.of_poses(commanded), sets)[1]
        reached = attained(robot, [Polytope.about(campaign, one) for one in sets], sets, commanded)
        outside = int(np.sum((position > found.position) | (angle > found.rotation)))
        ratios = u.max() / position.max(), found.position.max() / position.max(), np.median(found.position / reached)
        rows.append((100.0 * np.mean(position <= u), *ratios, outside))
        holds, first, second, third = map("{:.3g}".format, rows[-1][:4])
        said = f"{holds} %; {first}; {outside}; {second}; {third}"
        print(f"{options}: {min(errors):.3f} to {max(errors):.3f}; {said}", flush=True)
    table = np.array(rows)
    least, most, middle = table.min(axis=0), table.max(axis=0), np.median(table, axis=0)
    print(f"U holds at {least[0]:.3g} to {most[0]:.3g} %; outside of the bound {table[:, 4].sum():.0f} of all")
    for k, name in enumerate(("U / truth", "bound / truth", "bound / attained"), 1):
        print(f"{name}: median {middle[k]:.3g}, from {least[k]:.3g} to {most[k]:.3g}")


def default(campaigns: int = 20, poses: int = 100) -> None:
    """The model error that is suggested, where nobody states one."""
    print("study, random poses measured: suggested [mm]; outside of the bound, of these named, named, of")
    counts = np.zeros(4, dtype=int)
    kinds = [*KINDS[::2], {"bump": _BUMP}]
    for k in range(campaigns):
        kind = kinds[k % len(kinds)]
        more = 12 * (k // len(kinds) % 2)
        campaign, here, readings = _studied({**kind, "seed": k + 1}, poses, more)
        known = np.stack([fit_model(campaign, leg) for leg in range(1, 7)])
        commanded = forward_kinematics(Robot.from_parameters("controller", known), readings, here)
        away = distance_from_measured(campaign, readings)
        errors = [suggested_error(campaign, leg, float(away[:, leg - 1].max()))[0] for leg in range(1, 7)]
        found = cell_bounds(Cells.of_poses(commanded), _sets(campaign, errors, known))[1]
        position, angle = distances(here, commanded)
        outside, named = (position > found.position) | (angle > found.rotation), (away > FAR).any(axis=1)
        row = [*(int(np.sum(of)) for of in (outside, outside & named, named)), poses]
        counts += row
        print(f"{kind}, {more}: {min(errors):.3f} to {max(errors):.3f}; {', '.join(map(str, row))}", flush=True)
    print(f"all: outside {counts[0]}, of these named {counts[1]}; named {counts[2]}; of {counts[3]}")


def _true_error(campaign: Campaign, others: Campaign, leg: int) -> float:
    """mm: with it some parameters satisfy the leg's equation at all poses of `others` and, for readings in their sets,
    of the campaign."""
    start = fit_model(campaign, leg)
    network = leg_network(_joined([campaign, others]), leg, leg_box(start, 50.0), eps=(0.0, np.inf))
    # the parameters nearby whose largest error is (locally) least, and that error
    *x, error = minimax_fit(Rows(network), network.names.index("eps"), network.domain, np.append(start, 0.0))
    error = max(float(error), 0.0)
    while any(certify_point(given, leg, x, eps=error).fails for given in (campaign, others)):
        error = 1.0001 * error + 1e-7
    return error


def _joined(campaigns: list[Campaign]) -> Campaign:
    pose, run = ([name for c in campaigns for name in getattr(c, of)] for of in ("pose", "run"))
    arrays: dict[str, Any] = {name: np.concatenate([getattr(c, name) for c in campaigns]) for name in ARRAYS}
    return Campaign.of(campaigns[0].robot, *map(arrays.pop, ARRAYS[:3]), pose=pose, run=run, **arrays)


def outliers(campaigns: int = 50, outliers: str = "1,2,3") -> None:
    """Wrong measurements, found and proved."""
    print(" q found proved   of  median: certificates  kB  seconds (largest)")
    for q in map(int, outliers.split(",")):
        found = proved = 0
        figures = []
        for seed in range(1, 1 + campaigns):
            good = simulate(seed=seed, joint_error=0.1, noise=0.1, truncate=3.0)
            rng = np.random.default_rng([seed, q])
            wrong = rng.choice(len(good), q, replace=False)
            length = good.length.copy()
            length[wrong, 0] += rng.choice([-1.0, 1.0], q) * rng.uniform(1.0, 10.0, q)
            arrays = (good.robot, good.position, good.quaternion, length)
            campaign = Campaign.of(*arrays, pose=good.pose, run=good.run, uncertainty=good.uncertainty)
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
        print(f"{q:2} {found:5} {proved:6} {campaigns:4} {files:21.0f} {kilobytes:4.0f} {cpu:8.1f} ({worst:.1f})")


MODEL_ERRORS = ("noise", "joint", "sag", "gain", "axis")
_SIGMAS = np.repeat([0.03, 1e-4, 0.02], [3, 3, 1])


def tolerance(campaigns: int = 100) -> None:
    """The recommended parameters at unseen poses."""
    print("kind: ratios at T of 1/4, 1/2, 3/4, of the least E: medians; largest")
    every = np.array([_recommended(k) for k in range(campaigns)])
    for k, kind in enumerate((*MODEL_ERRORS, "all")):
        found = every[k :: len(MODEL_ERRORS)] if k < len(MODEL_ERRORS) else every
        medians, largest = (" ".join(f"{v:.2f}" for v in f(found, axis=0)) for f in (np.median, np.max))
        print(f"{kind}: {medians}; {largest}")


def verdicts(campaigns: int = 200) -> None:
    """False verdicts, over sensors and tolerances."""
    counts: Counter[str] = Counter()
    for seed in range(campaigns):
        rng = np.random.default_rng([seed, 1])
        campaign, errors, truth = _drawn(seed, 10.0 ** rng.uniform(-1.5, 0.5))
        (free,) = cpcal.certify(campaign, support="none").legs
        assert free.recommended is not None
        for t in rng.uniform(0.0, 2.0 * free.recommended.largest, 5).tolist():
            result = cpcal.certify(campaign, support="none", tolerance=t)
            (leg,), word = result.legs, cpcal.questions.verdict_of(result, result.legs[0]).word
            assert leg.recommended is not None
            off, true = (np.abs(errors(x)[:64]).max() > t for x in (leg.recommended.point, truth))
            counts[word] += 1
            counts["FALSE"] += (word == "pass" and off) or (word == "fail" and not true)
    print(dict(counts))


def _drawn(seed: int, scale: float) -> tuple[Campaign, Callable[[npt.ArrayLike], Floats], Floats]:
    """A campaign of 64 poses; the errors (464,) of parameters at the true poses, measured and unseen; the true ones."""
    rng, kind = np.random.default_rng(seed), MODEL_ERRORS[seed % len(MODEL_ERRORS)]
    a = np.append(rng.uniform(-500.0, 500.0, 2), rng.uniform(-30.0, 30.0))
    b = np.append(rng.uniform(-250.0, 250.0, 2), rng.uniform(-30.0, 30.0))
    size, phases, offset = rng.uniform(0.0, 1.0), rng.uniform(0.0, 2 * np.pi, 4), rng.uniform(200.0, 300.0)
    place = rng.uniform([-150.0, -150.0, 500.0], [150.0, 150.0, 800.0], (464, 3))
    turn = quaternion_from_rotation_vector(rng.uniform(-0.35, 0.35, (464, 3)))
    matrix = rotation_matrix(turn)
    v = place + matrix @ b - a
    far = np.linalg.norm(v, axis=1)
    error = {
        "noise": 0.0 * far,
        "joint": np.sin(v[:, 0] / 60.0 + phases[0]) * np.cos(v[:, 1] / 80.0 + phases[1]),
        "sag": -((far / far.mean()) ** 7) * (1.0 - (v[:, 2] / far) ** 2) * 2.0,
        "gain": (far - far.mean()) / np.ptp(far) * 2.0,
        "axis": (1.0 / far - np.mean(1.0 / far)) / np.ptp(1.0 / far) * 2.0,
    }[kind]
    read, sigmas = far + size * error - offset, scale * _SIGMAS
    noise = sigmas * np.clip(rng.standard_normal((64, 7)), -3.0, 3.0)
    seen = quaternion_product(small_rotation(noise[:, 3:6]), turn[:64])
    robot = Robot.from_parameters("drawn", np.array([[*a, *b, offset]]) + rng.standard_normal((1, 7)))
    stated = Uncertainty(sigmas[:3], sigmas[3:6], sigmas[6:], 3.0)
    length = (read[:64] + noise[:, 6])[:, None]

    def errors(x: npt.ArrayLike) -> Floats:
        at = np.asarray(x, np.float64)
        return np.asarray(np.linalg.norm(place + matrix @ at[3:6] - at[:3], axis=1) - read - at[6])

    campaign = Campaign.of(robot, place[:64] + noise[:, :3], seen, length, uncertainty=stated)
    return campaign, errors, np.array([*a, *b, offset])


def _recommended(seed: int) -> tuple[float, ...]:
    """Ratios of the three tolerances, and of the least E."""
    campaign, errors, _ = _drawn(seed, 1.0)
    (free,) = cpcal.certify(campaign, support="none").legs
    assert free.recommended is not None
    assert free.passes_from is not None
    least, own = free.passes_from.eps, free.recommended.largest
    tolerances = [least + share * (own - least) for share in (0.25, 0.5, 0.75)]
    legs = [cpcal.certify(campaign, support="none", tolerance=t).legs[0].recommended for t in tolerances]
    points = [leg.point for leg in legs if leg is not None] + [free.passes_from.point]
    every = [float(np.abs(errors(x)[64:]).max()) for x in (free.recommended.point, *points)]
    return tuple(value / every[0] for value in every[1:])


def mistakes(clean: int = 100, wrong: int = 3) -> None:
    """Clean campaigns that are named, and mistakes that are not."""
    named, most, seconds = 0, 0.0, 0.0
    for seed in range(clean):
        campaign = clean_campaign(seed)
        began = time.process_time()
        said = suspicions(campaign)
        seconds = max(seconds, time.process_time() - began)
        named += bool(said)
        ratio = spread_of(campaign).ratio
        most = max(most, 0.0 if ratio is None else float(ratio.max()))
        print(*(f"clean campaign {seed}, {campaign.robot.name}: {sentence}" for sentence in said), sep="\n", end="")
    print(f"{named} of {clean} clean campaigns named; residuals up to {most:.1f} times the stated; {seconds:.1f} s")
    right, of, seconds = 0, 0, 0.0
    for seed in range(1, 1 + wrong):
        campaign = simulate(seed=seed, deviation=float(seed), joint_error=0.1, random_poses=20 * (seed % 2))
        for way, (entered, name) in WRONG_WAYS.items():
            if way in UNNAMED:
                continue
            began = time.process_time()
            said = suspicions(entered(campaign))
            seconds = max(seconds, time.process_time() - began)
            good = bool(said) and name in said[0]
            right, of = right + good, of + 1
            if not good:
                print(f"{way}, drawing off by {seed} mm: {said}")
    print(f"{right} of {of} mistakes named ({len(WRONG_WAYS) - len(UNNAMED)} kinds); {seconds:.1f} s at most")


UNNAMED = ("duplicate rows", "one outlier", "one wrong pose", "constant pose")  # `check` finds them otherwise


def clean_campaign(seed: int) -> cpcal.Campaign:
    """A campaign as it should be: every other one of the DeltaLab platform."""
    rng = np.random.default_rng(seed)
    known = list(ROBOTS.values())[(seed // 2) % len(ROBOTS) if seed % 2 else 0]
    count, small = int(rng.integers(12, 201)), 0.05 if known.robot.name.startswith("Rubin") else 1.0
    extremal = bool(seed % 3) and count > 64 and known.workspace is None
    joint_error = small * (0.0, 0.1, 0.3, 1.0)[seed % 4]
    options: dict[str, Any] = {"deviation": small * rng.uniform(0.0, 10.0), "joint_error": joint_error}
    options |= {"workspace": known.workspace} if known.workspace else {"stroke": known.stroke}
    number = count - 64 * extremal
    return simulate(known.robot, seed=seed, random_poses=number, extremal=extremal, **options)


if __name__ == "__main__":
    run_by_hand(accuracy, default, outliers, tolerance, verdicts, mistakes)
