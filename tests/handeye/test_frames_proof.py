"""What is proved of simulated hand-eye studies holds of their truth; what is false is refused."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from cpcal.handeye.certify_hand_eye import Within, certify_hand_eye
from cpcal.handeye.exact_errors import PlacedFrames, exact_errors, largest
from cpcal.handeye.frame_equations import unknowns_of
from cpcal.handeye.frames_chain import Chain, LinkStep
from cpcal.handeye.frames_chain import _linked as prove_linked
from cpcal.handeye.frames_proof import box_of
from cpcal.handeye.hand_eye_files import hand_eye_files
from cpcal.handeye.hand_eye_result import load_hand_eye_result, save_hand_eye_result
from cpcal.handeye.parameter_ranges import parameter_ranges
from cpcal.handeye.simulate_hand_eye import simulate_hand_eye
from cpcal.handeye.verify_hand_eye import verify_hand_eye

NEAR = Within(50.0, 1.5)


def small(**options):
    return simulate_hand_eye(**({"images": 7, "corners": (4, 3), "pitch": 60.0} | options))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of a small study, and its truth."""
    folder = tmp_path_factory.mktemp("handeye")
    simulated = small(seed=5)
    for name, content in hand_eye_files(simulated.study).items():
        (folder / name).write_bytes(content)
    result = certify_hand_eye(simulated.study, within=NEAR, certificates=folder)
    save_hand_eye_result(result, folder)
    return folder, simulated, result


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_truth_lies_in_the_guaranteed_ranges_of_its_pixel_error(setup, seed):
    simulated = small(setup=setup, seed=seed)
    result = certify_hand_eye(simulated.study, within=NEAR, tolerance=0.2)
    x = unknowns_of(simulated.truth)
    assert result.passes is True
    assert not result.ranges.empty
    assert (np.array(result.ranges.lo) <= x).all()
    assert (x <= np.array(result.ranges.hi)).all()
    worst = largest(exact_errors(simulated.study, PlacedFrames.of(simulated.truth)))
    assert result.eps_lo <= worst <= 0.2 + 1e-9


def test_the_bracket_closes_to_a_millionth(finished):
    _, _, result = finished
    assert result.complete
    assert 0.0 < result.eps_lo <= result.eps_hi <= result.eps_lo * (1.0 + 1e-6)


def test_a_tolerance_below_the_bracket_is_refuted():
    simulated = small(seed=5)
    result = certify_hand_eye(simulated.study, within=NEAR, tolerance=0.1)
    assert result.passes is False
    assert result.ranges.empty


def test_a_run_is_verified(finished):
    folder, _, _ = finished
    found = verify_hand_eye(folder)
    assert [accepted for accepted, _ in found] == [True] * 5
    assert load_hand_eye_result(folder) == finished[2]


FORGERIES = {
    "a larger lower end": lambda d: d.update(eps_lo=d["eps_lo"] * (1 + 1e-9)),
    "a smaller upper end": lambda d: d.update(eps_hi=d["eps_hi"] * (1 - 1e-9)),
    "a narrower range": lambda d: d["ranges"]["low"].__setitem__(0, d["ranges"]["low"][0] + 1e-3),
    "a narrower box of unknowns": lambda d: d["ranges"]["hi"].__setitem__(9, d["ranges"]["hi"][9] - 1e-3),
    "a smaller tolerance of the ranges": lambda d: d["ranges"].update(eps=d["ranges"]["eps"] * 0.99),
    "a wider search": lambda d: d["asked"].update(reach=200.0),
    "any rotation": lambda d: d["asked"].update(angle=None),
    "another point": lambda d: d["point"]["camera_position"].__setitem__(0, 0.0),
    "readings of exact poses": lambda d: d.update(readings=[[1e-9] * 6] * 7),
    "another pose of an image": lambda d: d["ranges"]["chain"]["images"][0]["hi"].__setitem__(11, 0.0),
    "an image less": lambda d: d["ranges"]["chain"]["images"].pop(),
    "another nominal pose": lambda d: d["ranges"]["chain"]["images"][0]["nominal"]["place"].__setitem__(2, 1.0),
    "a link less": lambda d: d["ranges"]["chain"]["links"].pop(),
    "a better classical answer": lambda d: d["classical"]["images"][0].update(largest=0.0),
    "another support": lambda d: d["support"].pop(),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_an_edited_answer_is_refused(finished, refused, name):
    assert refused(finished[0], "handeye.json", FORGERIES[name], verify_hand_eye)


def test_a_certificate_of_other_pixels_is_refused(finished, tmp_path):
    shutil.copytree(finished[0], tmp_path / "run")
    points = (tmp_path / "run" / "points.csv").read_text().splitlines()
    points[1:] = [
        ",".join([a, b, repr(float(u) + 1.0), *rest]) for a, b, u, *rest in (p.split(",") for p in points[1:])
    ]
    (tmp_path / "run" / "points.csv").write_text("\n".join(points) + "\n")
    found = verify_hand_eye(tmp_path / "run")
    assert [accepted for accepted, _ in found][1:4] == [False] * 3


def narrowed(one):
    """A pose set with nine tenths of its sides, which nothing proves."""
    lo, hi = np.array(one.lo), np.array(one.hi)
    return replace(one, lo=tuple((lo + 0.05 * (hi - lo)).tolist()), hi=tuple((hi - 0.05 * (hi - lo)).tolist()))


def test_links_that_rest_on_narrower_poses_than_are_proved_are_refused(finished, tmp_path):
    """Made by the writer itself: each certificate is accepted, and follows from the poses that the run states. Only
    where these are compared with what the images' own certificates prove is it seen that they are others."""
    shutil.copytree(finished[0], tmp_path / "run")
    _, simulated, result = finished
    study, asked, ranges = simulated.study, result.asked, result.ranges
    box = box_of(asked.lo, asked.hi)

    def forged(sets):
        links = prove_linked(study, sets, asked.center, ranges.eps, box, "ranges", np.inf, lambda text: None)
        steps = []
        for k, (proof, cuts) in enumerate(links):
            proof.write(tmp_path / "run" / f"forged-{k}.cert.jsonl")
            steps.append(LinkStep(f"forged-{k}.cert.jsonl", cuts))
        return links[-1][0].left, Chain(sets, tuple(steps), ())

    def verdict(left, chain):
        lo, hi = left.lo.tolist(), left.hi.tolist()
        low, high = parameter_ranges(lo, hi, result.point)
        stated = replace(ranges, chain=chain, lo=tuple(lo), hi=tuple(hi), low=low, high=high)
        save_hand_eye_result(replace(result, ranges=stated), tmp_path / "run")
        return verify_hand_eye(tmp_path / "run")[3]

    true, false = ranges.chain.images, tuple(map(narrowed, ranges.chain.images))
    assert verdict(*forged(true))[0]
    accepted, sentence = verdict(*forged(false))
    assert not accepted
    assert "proves other bounds of the pose in" in sentence


def test_a_certificate_with_a_forged_constraint_is_refused(finished, tmp_path):
    shutil.copytree(finished[0], tmp_path / "run")
    path = tmp_path / "run" / "lower-1.cert.jsonl"
    lines = path.read_text().splitlines()
    place = next(k for k, text in enumerate(lines) if '"name":"image' in text)
    lines[place] = (
        lines[place]
        .replace('"at_most":[]', '"at_most":[[[],"0x1p-3"]]')
        .replace('"at_most":null', '"at_most":[[[],"-0x1p+3"]]')
    )
    path.write_text("\n".join(lines) + "\n")
    assert not verify_hand_eye(tmp_path / "run")[1][0]
