"""The lower end of the bracket: the largest tolerance found at which nothing explains all pixels, with its proof."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from cpcal.common.numbers import at_least
from cpcal.common.values import Floats
from cpcal.handeye.chain import (
    ChainProof,
    frame_rows,
    nominal_poses,
    nothing,
    pose_domain,
    pose_row_meaning,
    prove,
    prove_chain,
    prove_pose,
)
from cpcal.handeye.contraction import FramePrograms, Tell
from cpcal.handeye.minimax_fit import minimax_fit
from cpcal.handeye.rows import PlacedFrames, row_meaning
from cpcal.handeye.study import PARAMETERS, HandEyeFrames, HandEyeStudy, PixelModel, ReadFrames, moved, read_study
from cpcal.solver.interval import Box
from cpcal.solver.linear import LinearStatus

_NOTHING = 1e-12  # px: what rounding leaves of pixels that fit exactly
_HOPELESS = 1e-2  # of eps_hi: a lower end that is not worth the search
_SHORT = (1e-3, 0.03)  # of what is left below a bound that linear programs promise, given away for a proof
_NEAR = (0.0, 1e-6, 1e-4, 1e-2)  # shares given away below an image's own least error
_BETWEEN = (0.95, 0.7, 0.4)  # of the way from a single image's error to eps_hi: what all images may refute


def lower_end(
    study: HandEyeStudy,
    wide: ChainProof,
    center: PlacedFrames,
    best: ReadFrames,
    eps_hi: float,
    gap: float,
    *,
    about: str,
    time_limit: float,
    tell: Tell,
) -> tuple[float, ChainProof | None]:
    """eps_lo and its proof, which begins with what `wide` leaves, or with its box if that left nothing."""
    if eps_hi <= _NOTHING:
        return 0.0, None
    just_below = eps_hi * (1.0 - 0.9 * gap)
    domain = wide.domain if wide.refuted else wide.left
    if study.pose_half_width.any():
        return _of_uncertain(study, wide, domain, center, best, just_below, about, time_limit, tell)
    if wide.refuted:
        tell(f"is there anything below {at_least(just_below, 7)} px?")
        tried = prove_chain(study, just_below, domain, center, about=about, time_limit=time_limit, tell=tell)
        if tried.refuted:
            return just_below, tried
        return wide.eps, wide
    return _of_exact(study, domain, just_below, about, time_limit, tell)


def _of_exact(
    study: HandEyeStudy, domain: Box, eps: float, about: str, time_limit: float, tell: Tell
) -> tuple[float, ChainProof | None]:
    most = eps
    for shortened in (0.0, *_SHORT):
        eps *= 1.0 - shortened
        if not eps > _HOPELESS * most:
            break
        tell(f"is there anything below {at_least(eps, 7)} px?")
        began = time.monotonic()
        proof = prove(study, eps, domain, about=about, time_limit=time_limit, tell=tell)
        if proof.refuted:
            return eps, ChainProof(eps, domain, proof.left, (), (), (proof,))
        if not proof.steps and time.monotonic() > began + time_limit:  # there was no time for one
            break
        eps = promised(study, proof.left, eps) * (1.0 - 1e-6)
    return 0.0, None


def promised(study: HandEyeStudy, box: Box, eps: float) -> float:
    """About the largest tolerance at which the linear programs find nothing in a box, below `eps`: a guess."""
    low, high = 0.0, eps
    for _ in range(12):
        middle = 0.5 * (low + high)
        rows, places = frame_rows(study, middle)
        programs = FramePrograms(rows, places, box, np.ones(rows.products.shape[1], dtype=np.bool_))
        if programs.minimize(None, 1.0).status is LinearStatus.INFEASIBLE:
            low = middle
        else:
            high = middle
    return low


# uncertain poses of the robot ---------------------------------------------------------------------------------------


def _of_uncertain(
    study: HandEyeStudy,
    wide: ChainProof,
    domain: Box,
    center: PlacedFrames,
    best: ReadFrames,
    most: float,
    about: str,
    time_limit: float,
    tell: Tell,
) -> tuple[float, ChainProof | None]:
    """A single image with any pose is what mostly forces the error; else all of them with their readings."""
    found: tuple[float, ChainProof | None] = (wide.eps, wide) if wide.refuted else (0.0, None)
    alone = least_errors(study, best)
    image = max(alone, key=lambda k: alone[k], default=None)
    if image is not None:
        limit = min(most, alone[image])
        for eps in (limit * (1.0 - share) for share in _NEAR):
            if eps <= found[0]:
                break
            tell(f"does {study.images[image]} alone allow anything below {at_least(eps, 7)} px?")
            nominal = nominal_poses(study)[image]
            proof = prove_pose(study, image, nominal, eps, pose_domain(study, image, nominal, domain))
            if proof.refuted:
                refuted = ((study.images[image], nominal, proof),)
                found = eps, ChainProof(eps, domain, nothing(domain), refuted, (), ())
                break
    if most > found[0] * (1.0 + 1e-3):
        for share in _BETWEEN:
            eps = found[0] + share * (most - found[0])
            tell(f"is there anything below {at_least(eps, 7)} px?")
            chain = prove_chain(study, eps, domain, center, about=about, time_limit=time_limit, tell=lambda text: None)
            if chain.refuted:
                return eps, chain
    return found


class _OneImage:
    """Residuals of one image by its own pose in the camera frame (6)."""

    def __init__(self, study: HandEyeStudy) -> None:
        self.study, self.size = study, PARAMETERS // 2
        self._model = PixelModel(study)

    def __call__(self, at: HandEyeFrames) -> Floats:
        return self._model(at)

    def jacobian(self, at: HandEyeFrames) -> Floats:
        return self._model.jacobian(at)[:, : self.size]

    def moved(self, at: HandEyeFrames, step: Floats) -> HandEyeFrames:
        return moved(at, np.append(step, np.zeros(PARAMETERS - self.size)))

    def reach(self, at: HandEyeFrames) -> Floats:
        return self._model.reach(at)[: self.size]

    def room(self, at: HandEyeFrames) -> tuple[Floats, Floats]:
        low, high = self._model.room(at)
        return low[: self.size], high[: self.size]


def least_errors(study: HandEyeStudy, best: ReadFrames) -> dict[int, float]:
    """By image, about the least error in px that its pixels allow with any pose of the target; found near `best`."""
    there = read_study(study, best.readings)
    kept = nominal_poses(study)
    return {k: minimax_fit(_OneImage(there.part(np.array([k]))), best.frames, restarts=1)[1] for k in kept}


def support(study: HandEyeStudy, lower: ChainProof | None) -> tuple[tuple[str, str], ...]:
    """Image and point of the pixel rows of the last step."""
    return tuple(dict.fromkeys(_support(study, lower)))


def _support(study: HandEyeStudy, lower: ChainProof | None) -> Iterator[tuple[str, str]]:
    if lower is None:
        return
    if lower.pixels:
        for _, k in lower.pixels[-1].steps[-1]["rows"]:
            meaning = row_meaning(k, len(study.image))
            if meaning is not None:
                yield study.images[study.image[meaning[0]]], study.names[meaning[0]]
    elif not lower.links:
        image, _, proof = lower.images[-1]
        names = [n for n, k in zip(study.names, study.image, strict=True) if study.images[k] == image]
        for _, k in proof.steps[-1]["rows"]:
            point = pose_row_meaning(k)
            if point is not None:
                yield image, names[point]
