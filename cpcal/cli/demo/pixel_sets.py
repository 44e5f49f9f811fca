"""The demo's second campaign: reading sets proved from pixel boxes, one image a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from cpcal.cli.certify import certified_into
from cpcal.cli.demo.image_study import ImageStudy
from cpcal.cli.folders import PIXEL_CAMPAIGN, PIXEL_RUN, PIXEL_SETS
from cpcal.cli.talk import Talk
from cpcal.common.errors import ModelError
from cpcal.common.numbers import about, bracket_text, nearest, stated
from cpcal.files import save_campaign
from cpcal.files.run_folder import POSE_SETS, answers_into
from cpcal.questions import Result
from cpcal.report.study_report import ImagesFound, TextTable
from cpcal.robot import Campaign
from cpcal.solver.contract import Verdict
from cpcal.vision.batch.detect import in_parallel
from cpcal.vision.batch.enclose import stem_of
from cpcal.vision.batch.study_images import RenderedImages
from cpcal.vision.files.detection import readings_of
from cpcal.vision.measure import measure_pose
from cpcal.vision.pose_sets import PixelBoxes, PoseSet, campaign_of, enclose_pose

HALF_WIDTH = 0.03  # pixels: every dot's box; no dot of the demo's images is farther from where it should be


@dataclass(frozen=True)
class _Enclosing:
    """What a worker does: pose sets of some images, each with a certificate in `folder` where one can be made."""

    images: RenderedImages
    folder: Path

    def __call__(self, names: Sequence[str]) -> list[tuple[str, PoseSet]]:
        return [(name, self._one(name)) for name in names]

    def _one(self, name: str) -> PoseSet:
        target, camera = self.images.target, self.images.camera
        found = measure_pose(self.images.read(name), target, camera)
        boxes = PixelBoxes.around(found.numbers, found.centers, HALF_WIDTH, of_images=True)
        try:
            return enclose_pose(boxes, target, camera, certificate=self.folder / stem_of(name))
        except ModelError:  # the proof in exact numbers is a little weaker
            return enclose_pose(boxes, target, camera)


@dataclass(frozen=True)
class PixelRun:
    """Pose sets by the image's name, the campaign of those that are proved, and what was certified of it."""

    sets: dict[str, PoseSet]
    campaign: Campaign
    result: Result


def certify_pixels(
    done: ImageStudy,
    campaign: Campaign,
    legs: Sequence[int] | None,
    folder: Path,
    talk: Talk,
    *,
    every: int = 1,
    resume: bool,
) -> PixelRun:
    """One image of each (of every n-th) configuration of `campaign`, whose legs' reading sets are kept.

    Raises InputError.
    """
    images, found = done.shots["calibration"], done.found["calibration"]
    first: dict[str, str] = {}
    for row in found.rows:
        if row.found:
            first.setdefault(PurePosixPath(row.file).parts[0], row.file)
    rows = range(0, len(campaign), every)
    names = [first[campaign.pose[k]] for k in rows]
    with answers_into(folder / PIXEL_SETS, POSE_SETS) as draft:
        sets = dict(pair for pairs in in_parallel(_Enclosing(images, draft), names) for pair in pairs)
    enclosed = {k: name for k, name in zip(rows, names, strict=True) if sets[name].verdict is Verdict.PROVED}
    proved = list(enclosed)
    runs = [PurePosixPath(name).parts[1] for name in enclosed.values()]
    readings = readings_of(done.study.calibration)
    pixel = campaign_of(
        [sets[name] for name in enclosed.values()],
        np.array([readings[campaign.pose[k], run] for k, run in zip(proved, runs, strict=True)]),
        campaign.robot,
        length_radius=campaign.length_radius[proved],
        pose=[campaign.pose[k] for k in proved],
        run=runs,
        provenance={
            "reading sets": f"poses from pixel boxes of +-{stated(HALF_WIDTH)} px, proved; "
            "legs as in the other campaign"
        },
    )
    save_campaign(pixel, folder / PIXEL_CAMPAIGN)
    result = certified_into(folder / PIXEL_RUN, pixel, {"legs": legs}, talk=talk, resume=resume)
    return PixelRun(sets, pixel, result)


def with_sets(found: ImagesFound, done: ImageStudy, run: PixelRun, campaign: Campaign, result: Result) -> ImagesFound:
    """The page's words on the images, and those on the pixel sets beside the sets from repeats."""
    names = list(run.sets)
    count, refuted = len(names), sum(run.sets[n].verdict is Verdict.REFUTED for n in names)
    proved = [n for n in names if run.sets[n].verdict is Verdict.PROVED]
    holding = sum(done.shots["calibration"].pose(name) in run.sets[name] for name in proved)
    seconds = np.median([run.sets[name].seconds for name in names])
    said = (
        f"Each dot of one image a configuration is stated to be within ±{stated(HALF_WIDTH)} pixels of where it was "
        "found (the centre of its image); camera and plate are assumed exact: the images were rendered with them. "
        f"Of {count} sets of poses that show all dots in such boxes, {len(proved)} are enclosed and {refuted} empty, "
        f"both proved, in {about(float(seconds), 2)} s each with a certificate. The true pose lies in {holding} of the "
        f"{len(proved)}. No page checks these proofs: `cpcal verify {PIXEL_SETS}` does. "
        "The half-widths of the enclosures, beside those of the first campaign's reading sets:",
        "These sets are the readings' sets of a second campaign, certified as the first is: for some pose that the "
        "pixels allow, and some leg reading in its set. So the proof begins at the image. The smallest model error of "
        "each leg, for both campaigns:",
    )
    return replace(found, sets=_widths(run.campaign, campaign), brackets=_brackets(run.result, result), sets_said=said)


def _widths(pixel: Campaign, repeats: Campaign) -> TextTable:
    head = ("half-width, median", *(f"{n} [µm]" for n in "xyz"), *(f"r{n} [10⁻³ °]" for n in "xyz"))
    rows = []
    for name, one in ((f"pixels ±{stated(HALF_WIDTH)}", pixel), ("repeats, as in table 3", repeats)):
        position = 1e3 * np.median(one.position_radius, axis=0)
        rotation = 1e3 * np.degrees(np.median(one.rotation_radius, axis=0))
        rows.append((name, *(nearest(float(v), 1) for v in (*position, *rotation))))
    return TextTable(head, tuple(rows))


def _brackets(pixel: Result, repeats: Result) -> TextTable:
    rows = []
    for name, result in (("pixels", pixel), ("repeats", repeats)):
        bounds = [bracket_text(leg.eps_lo, leg.eps_hi) for leg in result.legs]
        rows.append((f"{name}: none below [mm]", *(lo for lo, _ in bounds)))
        rows.append((f"{name}: attained [mm]", *(hi for _, hi in bounds)))
    return TextTable(("leg", *(str(leg.leg) for leg in repeats.legs)), tuple(rows))
