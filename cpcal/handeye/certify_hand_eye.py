"""The certified answer: eps* between two bounds, ranges of the parameters, verdicts of the classical answer.

S(eps) = { (X, F) in the box : for every point a pixel within its half-width is met to within eps on both axes }
eps*   = min { eps : S(eps) is not empty }
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import at_least, at_most
from cpcal.common.version import __version__
from cpcal.handeye.classical_answer import ClassicalAnswer, classical_answer
from cpcal.handeye.exact_errors import PlacedFrames, above, exact_errors, largest
from cpcal.handeye.exact_rows import row_meaning
from cpcal.handeye.frame_equations import (
    R_F,
    R_X,
    SIZE,
    T_F,
    T_X,
    UNKNOWNS,
    Quadratics,
    pixel_rows,
    rotation_rows,
    unknowns_of,
)
from cpcal.handeye.frame_programs import FramePrograms
from cpcal.handeye.frames_proof import FramesProof, prove_in_turns
from cpcal.handeye.hand_eye_result import (
    LOWER,
    RANGES,
    AskedBox,
    Classical,
    FrameRanges,
    HandEyeResult,
    ImageVerdict,
    unknown_range,
)
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.minimax_fit import minimax_fit
from cpcal.handeye.parameter_ranges import parameter_ranges
from cpcal.handeye.pixel_model import PixelModel
from cpcal.handeye.pose_slack import pose_slack
from cpcal.solver.interval import Box
from cpcal.solver.linear import LinearStatus

REACH = 2000.0  # mm: the box around the classical positions
GAP = 1e-6
_BEYOND = 1.1  # of eps_hi: the tolerance of the ranges
_HOPELESS = 1e-2  # of eps_hi: a lower end that is not worth the search
_SHORT = (1.0, 1e-3, 0.03)  # of what is left below a bound that linear programs promise, given away for a proof

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Within:
    """The box: positions within `reach` mm of the classical ones, rotations within `angle` degrees (None: any)."""

    reach: float = REACH
    angle: float | None = None

    @staticmethod
    def parsed(text: str) -> Within:
        """Of `DEGREES,MM`, or `any,MM`. Raises InputError."""
        parts = [part.strip() for part in text.split(",")]
        try:
            angle = None if parts[0] == "any" else float(parts[0])
            reach = float(parts[1]) if len(parts) == 2 else math.nan
        except ValueError:
            reach, angle = math.nan, None
        if not 0.0 < reach < 1e6 or (angle is not None and not 0.0 < angle <= 180.0):
            remedy = "give degrees and mm, such as 60,1000; or any,2000 for any rotation"
            raise InputError([Problem("option --within", f"is {text!r:.60}", remedy)])
        return Within(reach, angle)

    def asked(self, center: PlacedFrames, x: Floats) -> AskedBox:
        """The box about the unknowns x of the classical answer, rounded outward."""
        lo, hi = x.copy(), x.copy()
        turns, shifts = [*R_X, *R_F], [*T_X, *T_F]
        # entries of rotations that differ by an angle differ by at most 2 sin(angle / 2)
        span = 2.0 if self.angle is None else 2.0 * math.sin(math.radians(self.angle) / 2.0) * (1.0 + 1e-12) + 1e-12
        lo[turns], hi[turns] = np.maximum(x[turns] - span, -1.0), np.minimum(x[turns] + span, 1.0)
        lo[shifts] = np.nextafter(x[shifts] - self.reach, -np.inf)
        hi[shifts] = np.nextafter(x[shifts] + self.reach, np.inf)
        return AskedBox(center, self.reach, self.angle, tuple(lo.tolist()), tuple(hi.tolist()))


def certify_hand_eye(
    study: HandEyeStudy,
    *,
    within: Within | None = None,
    tolerance: float | None = None,
    gap: float = GAP,
    method: str = "shah",
    certificates: Path | None = None,
    time_limit: float = math.inf,
    tell: Tell = lambda text: None,
) -> HandEyeResult:
    """Bracket eps* of a study, and the ranges of its parameters.

    within        the box; default any rotation, positions within 2 m of the classical answer on each axis
    tolerance     px: are there frames that explain every pixel to it, and in which ranges? Default: ranges at 1.1 eps*
    gap           relative width of the bracket that is asked for
    certificates  a folder that exists, for `lower-1.cert.jsonl` and `ranges-1.cert.jsonl`, and so on
    time_limit    seconds for each of the proofs; what is proved until then is stated

    Raises InputError for studies without a classical answer, and where its points lie outside of the box.
    """
    began = time.monotonic()
    if tolerance is not None and not 0.0 <= tolerance < math.inf:
        raise InputError([Problem("tolerance", f"is {tolerance}", "give pixels, from 0")])
    classical = classical_answer(study, method=method)
    center = PlacedFrames.of(classical.frames)
    asked = (within or Within()).asked(center, unknowns_of(classical.frames))
    frames, _ = minimax_fit(PixelModel(study), classical.frames)
    point = PlacedFrames.of(frames)
    worst = largest(exact_errors(study, point))
    assert worst is not None  # the fit keeps all points in front of the camera
    eps_hi = above(worst)
    domain = Box(UNKNOWNS, asked.lo, asked.hi)
    if not domain_holds(domain, unknowns_of(frames)):
        raise InputError([Problem("option --within", "leaves out the best frames found", "give a larger box")])
    tell(f"some frames explain every pixel to {at_most(eps_hi, 7)} px")
    at = _BEYOND * eps_hi if tolerance is None else tolerance
    wide = prove_in_turns(study, at, domain, about=about_study(study, at), time_limit=time_limit, tell=tell)
    eps_lo, lower = _lower(study, wide, eps_hi, gap, time_limit, tell)
    written = tuple(_written(proofs, name, certificates) for proofs, name in ((lower, LOWER), (wide, RANGES)))
    return HandEyeResult(
        version=__version__,
        setup=study.setup,
        images=len(study.images),
        points=len(study.image),
        asked=asked,
        eps_lo=eps_lo,
        eps_hi=eps_hi,
        gap=gap,
        point=point,
        support=_support(study, lower),
        lower=written[0],
        tolerance=tolerance,
        ranges=_ranges(wide[-1], point, written[1]),
        classical=_judged(study, classical, center, at),
        programs=sum(proof.programs for proof in (*wide, *lower)),
        seconds=time.monotonic() - began,
    )


def _written(proofs: tuple[FramesProof, ...], name: str, folder: Path | None) -> tuple[str, ...]:
    """The names of the certificates, once they are written; none where there is no folder."""
    names = tuple(f"{name}-{k + 1}.cert.jsonl" for k in range(len(proofs)))
    if folder is None:
        return ()
    for proof, file in zip(proofs, names, strict=True):
        proof.write(folder / file)
    return names


def domain_holds(domain: Box, x: Floats) -> bool:
    """Whether a point is in the box, for what float64 makes of a rotation."""
    return bool(((domain.lo <= x + 1e-9) & (x - 1e-9 <= domain.hi)).all())


def about_study(study: HandEyeStudy, eps: float) -> str:
    """What certificates say of themselves."""
    return (
        f"cpcal hand-eye, {study.setup}: X camera in {'hand' if study.setup == 'eye-in-hand' else 'base'}, "
        f"F target in {'base' if study.setup == 'eye-in-hand' else 'hand'}, mm; every pixel within eps = {eps.hex()} px"
    )


# the lower end -----------------------------------------------------------------------------------------------------


def _lower(
    study: HandEyeStudy, wide: tuple[FramesProof, ...], eps_hi: float, gap: float, limit: float, tell: Tell
) -> tuple[float, tuple[FramesProof, ...]]:
    """The largest eps that is proved to explain not all pixels, with the proofs; 0 without one."""
    if wide[-1].refuted:
        return wide[-1].eps, wide
    eps, known = eps_hi * (1.0 - 0.9 * gap), wide[0]
    if study.pose_half_width.any():  # what poses may move is lost to the lower end, so it is not near the upper one
        eps = promised(study, wide[-1].left, eps) * (1.0 - _SHORT[1])
    for shortened in _SHORT:
        if not eps > _HOPELESS * eps_hi:
            break
        tell(f"is there anything below {at_least(eps, 7)} px?")
        tried = prove_in_turns(
            study, eps, known.domain, about=about_study(study, eps), replayed=known if known.eps >= eps else None,
            time_limit=limit, tell=tell,
        )  # fmt: skip
        if tried[-1].refuted:
            return eps, tried
        known = tried[0]
        eps = promised(study, tried[-1].left, eps) * (1.0 - shortened if shortened < 1.0 else 1.0 - 1e-6)
    return 0.0, ()


def promised(study: HandEyeStudy, box: Box, eps: float) -> float:
    """About the largest tolerance at which the linear programs find nothing in a box, below `eps`: a guess."""
    low, high = 0.0, eps
    rotations = rotation_rows()
    for _ in range(12):
        middle = 0.5 * (low + high)
        rows = Quadratics.joined([rotations, pixel_rows(study, middle, pose_slack(study, middle, box))])
        programs = FramePrograms(rows, box, np.ones(rows.products.shape[1], dtype=np.bool_))
        if programs.minimize(None, 1.0).status is LinearStatus.INFEASIBLE:
            low = middle
        else:
            high = middle
    return low


def _support(study: HandEyeStudy, lower: tuple[FramesProof, ...]) -> tuple[tuple[str, str], ...]:
    """Image and point of the rows of the last step."""
    found = []
    for _, k in lower[-1].steps[-1]["rows"] if lower else ():
        meaning = row_meaning(k, len(study.image))
        if meaning is not None:
            found.append((study.images[study.image[meaning[0]]], study.names[meaning[0]]))
    return tuple(dict.fromkeys(found))


# ranges and verdicts -----------------------------------------------------------------------------------------------


def _ranges(wide: FramesProof, point: PlacedFrames, certificates: tuple[str, ...]) -> FrameRanges:
    if wide.refuted:
        nothing = (0.0,) * SIZE
        return FrameRanges(wide.eps, True, unknown_range(), unknown_range(), nothing, nothing, certificates)
    lo, hi = tuple(wide.left.lo.tolist()), tuple(wide.left.hi.tolist())
    low, high = parameter_ranges(lo, hi, point)
    return FrameRanges(wide.eps, False, low, high, lo, hi, certificates)


def _judged(study: HandEyeStudy, answer: ClassicalAnswer, placed: PlacedFrames, tolerance: float) -> Classical:
    """Exactly, image by image."""
    errors = exact_errors(study, placed)
    verdicts = []
    for k, name in enumerate(study.images):
        mine = largest([errors[n] for n in np.flatnonzero(study.image == k)])
        worst = math.inf if mine is None else above(mine)
        verdicts.append(ImageVerdict(name, worst, mine is not None and mine <= F(tolerance)))
    everything = largest(errors)
    return Classical(
        placed=placed,
        rms=answer.rms,
        largest=math.inf if everything is None else above(everything),
        sigma=tuple(np.sqrt(np.diagonal(answer.covariance)).tolist()),
        images=tuple(verdicts),
        remarks=answer.remarks,
    )
