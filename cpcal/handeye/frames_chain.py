"""A chain of proofs at one tolerance: single images, what ties them together, then all pixels.

1. Certified poses of the target in single images (`image_pose_sets`): no frames, no robot pose.
2. Rows that tie these together by the robot's motions (`pose_links`): from any frames to a small box, in turns, for
   what uncertain poses move depends on the box.
3. The pixels of all images (`frames_proof`), where the robot's poses are exact.

Each link begins with the box that the one before left. An image without a pose, or an empty box, refutes all.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.box_contraction import FramesProof, Tell
from cpcal.handeye.exact_errors import PlacedFrames
from cpcal.handeye.frames_proof import prove
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.image_pose_sets import ImagePoseSet, NominalPose, nominal_poses, pose_domain, prove_pose
from cpcal.handeye.link_cuts import useful_cuts
from cpcal.handeye.pose_links import Cut, Links, prove_links
from cpcal.robot import rotation_matrix
from cpcal.solver.interval import Box

_SPREAD = 9  # images that narrow the box where the robot's poses are exact: the pixels say the rest
_UNCERTAIN = 24  # images that narrow it where they are not: each takes time, and 40 leave 0.84 of what 24 do
_FEWEST = 3
_TURNS = 8
_WORTH = 0.8  # share of some width that another turn must be expected to leave, or less


@dataclass(frozen=True)
class LinkStep:
    """The name of a certificate that ties images together, and the cuts that it states."""

    certificate: str
    cuts: tuple[Cut, ...]


@dataclass(frozen=True)
class Chain:
    """Certificates, each of which begins where the one before ended; see the module.

    `images`: of single images, which begin with all poses. `pixels`: names of certificates.
    """

    images: tuple[ImagePoseSet, ...]
    links: tuple[LinkStep, ...]
    pixels: tuple[str, ...]

    @property
    def certificates(self) -> tuple[str, ...]:
        """The names of all files."""
        return (*(one.certificate for one in self.images), *(one.certificate for one in self.links), *self.pixels)


@dataclass(frozen=True, eq=False)
class ChainProof:
    """What is proved of a box of frames: `left` holds all that explain every pixel to within eps."""

    eps: float
    domain: Box
    left: Box
    images: tuple[tuple[str, NominalPose, FramesProof], ...]
    links: tuple[tuple[FramesProof, tuple[Cut, ...]], ...]
    pixels: tuple[FramesProof, ...]

    @property
    def refuted(self) -> bool:
        return self.left.is_empty

    @property
    def programs(self) -> int:
        proofs = (*(proof for *_, proof in self.images), *(proof for proof, _ in self.links), *self.pixels)
        return sum(proof.programs for proof in proofs)

    def written(self, name: str, folder: Path | None) -> Chain:
        """The chain as a run states it, its certificates written into the folder; empty without a folder."""
        if folder is None:
            return Chain((), (), ())

        def saved(proof: FramesProof, file: str) -> str:
            proof.write(folder / file)
            return file

        images = tuple(
            pose_set(image, nominal, proof, saved(proof, f"{name}-image-{k + 1}.cert.jsonl"))
            for k, (image, nominal, proof) in enumerate(self.images)
        )
        links = tuple(
            LinkStep(saved(proof, f"{name}-links-{k + 1}.cert.jsonl"), cuts)
            for k, (proof, cuts) in enumerate(self.links)
        )
        pixels = tuple(saved(proof, f"{name}-{k + 1}.cert.jsonl") for k, proof in enumerate(self.pixels))
        return Chain(images, links, pixels)


def pose_set(image: str, nominal: NominalPose, proof: FramesProof, certificate: str) -> ImagePoseSet:
    """As a run states it; without bounds where no pose is left."""
    nothing: tuple[float, ...] = ()
    lo, hi = (nothing if proof.refuted else tuple(end.tolist()) for end in (proof.left.lo, proof.left.hi))
    return ImagePoseSet(image, nominal, lo, hi, certificate)


def prove_chain(
    study: HandEyeStudy,
    eps: float,
    domain: Box,
    center: PlacedFrames,
    *,
    about: str,
    time_limit: float = np.inf,
    tell: Tell = lambda text: None,
) -> ChainProof:
    """Contract a box of frames about `center` until it is empty or gets no smaller, at a tolerance of eps px.

    After `time_limit` seconds no image and no turn more is begun, but for the fewest that say anything."""
    end = time.monotonic() + time_limit
    uncertain = bool(study.pose_half_width.any())
    nominal = nominal_poses(study)
    chosen = spread(study, sorted(nominal), _UNCERTAIN if uncertain else _SPREAD)
    images: list[tuple[str, NominalPose, FramesProof]] = []
    sets: list[ImagePoseSet] = []
    for k in chosen:
        if len(sets) >= _FEWEST and time.monotonic() > end:
            break
        proof = prove_pose(study, k, nominal[k], eps, pose_domain(study, k, nominal[k], domain))
        tell(f"{study.images[k]} alone: {'no pose is left' if proof.refuted else 'its pose is bounded'}")
        if proof.refuted:
            return ChainProof(eps, domain, nothing(domain), ((study.images[k], nominal[k], proof),), (), ())
        images.append((study.images[k], nominal[k], proof))
        sets.append(pose_set(study.images[k], nominal[k], proof, ""))
    links = _linked(study, sets, center, eps, domain, about, end, tell)
    left = links[-1][0].left
    if left.is_empty or uncertain:
        return ChainProof(eps, domain, left, tuple(images), links, ())
    rest = max(end - time.monotonic(), 0.0)
    pixels = prove(study, eps, left, about=about, time_limit=rest, tell=tell)
    return ChainProof(eps, domain, pixels.left, tuple(images), links, (pixels,))


def nominal_turn(center: PlacedFrames) -> tuple[float, ...]:
    """R_X0 of the links (9)."""
    return tuple(rotation_matrix(np.array(center.camera_quaternion)).ravel().tolist())


def nothing(domain: Box) -> Box:
    """Nothing."""
    return Box.empty(domain.names)


def _linked(
    study: HandEyeStudy,
    sets: Sequence[ImagePoseSet],
    center: PlacedFrames,
    eps: float,
    domain: Box,
    about: str,
    end: float,
    tell: Tell,
) -> tuple[tuple[FramesProof, tuple[Cut, ...]], ...]:
    found: list[tuple[FramesProof, tuple[Cut, ...]]] = []
    box = domain
    for turn in range(_TURNS):
        links = Links(study, sets, nominal_turn(center), box)
        # while the box is wide, what lies beyond first order is all that matters
        cuts = useful_cuts(links) if turn and study.pose_half_width.any() else ()
        proof = prove_links(links, cuts, eps, about=about, tell=tell)
        first = len(proof.statement.rows) - len(cuts)
        found.append((proof, tuple(cut for k, cut in enumerate(cuts, first) if k in proof.used)))
        left = proof.left
        if left.is_empty or (turn > 0 and not (left.width < _WORTH * box.width).any()) or time.monotonic() > end:
            break
        box = left
    return tuple(found)


def spread(study: HandEyeStudy, images: Sequence[int], count: int) -> list[int]:
    """So many of the images, each in turn the one whose pose is farthest from those chosen before."""
    if len(images) <= count:
        return list(images)
    turn = study.motions[0][list(images)].reshape(len(images), 9)
    place: Floats = study.poses.position[list(images)]
    place = place / max(float(np.ptp(place, axis=0).max()), 1e-9)
    where = np.concatenate([turn, place], axis=1)
    chosen = [0]
    gap = np.linalg.norm(where - where[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(where - where[chosen[-1]], axis=1))
    return sorted(images[k] for k in chosen)
