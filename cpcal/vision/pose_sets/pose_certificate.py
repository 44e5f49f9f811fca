"""Certificates of pose sets: the whole proof, from boxes of pixels to a box of poses (docs/certificate-format.md).

A claim NAME.pose.json states what is assumed (pixels, camera, target, frames, exact numbers) and the box of poses. Its
proof is a chain of certificates NAME.K.cert.jsonl of polynomial rows: of motions of the target at first, from all there
are, then of poses about a centre, each beginning where the one before it ends. The checker forms the rows from what is
assumed, and accepts none that does not follow.

With at most q dots in the wrong place there are several chains. The dots are dealt into groups, and each chain leaves
out q of them, each choice once. Whichever dots are wrong, they are in q groups at most: the chain without these holds
the pose. So the hull of what the chains leave does.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, ModelError, Problem
from cpcal.common.files import write_file
from cpcal.common.values import Floats, Indices
from cpcal.robot import Pose
from cpcal.solver.certificate.exact_network import limits, network_statement
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.contract import Contractor, Repeat
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted
from cpcal.solver.search import Contracting, Divide, LargestFirst, Search
from cpcal.vision.pose_sets.enclosed import Motions, PoseBox, pose_box
from cpcal.vision.pose_sets.pose_enclosure import Found, View, first_box, groups_of
from cpcal.vision.pose_sets.pose_rows import SIDES, motion_rows, motions_of, pose_rows
from cpcal.vision.pose_sets.sight import Sight
from cpcal.vision.pose_sets.uncertain import field_of_view

# ------------------------------------------------------------------------------------------------------------------
# NAME.pose.json: what a pose set assumes and claims, in exact numbers (docs/certificate-format.md).

POSE_SET_FORMAT = "cpcal-pose-set/2"
SUFFIX = ".pose.json"


class StageRow(NamedTuple):
    """A row of a certificate: of which of the dots listed, on which side, about which ray."""

    dot: int
    side: int
    x: float
    y: float


def inputs_of(sight: Sight, name: str, sources: Mapping[str, bytes]) -> dict[str, Any]:
    """All that is assumed; `sources`: the bytes of the files that the numbers came from, by name."""
    boxes, cameras, target = sight.boxes, sight.cameras, sight.targets.target
    files = [{"name": key, "sha256": hashlib.sha256(content).hexdigest()} for key, content in sorted(sources.items())]
    return {
        "name": name,
        "files": files,
        "pixels": {
            "of": "images" if boxes.of_images else "centers",
            "numbers": boxes.numbers.tolist(),
            "lo": _hex(boxes.lo),
            "hi": _hex(boxes.hi),
        },
        "camera": {
            "numbers": _hex(cameras.camera.numbers),
            "spread": _hex(cameras.spread),
            "ball": bool(cameras.ball),
            "field": _hex(field_of_view(cameras).radius),
        },
        "target": {
            "radius": _hex(target.radius),
            "dots": _hex(sight.dots),
            "half_widths": _hex(sight.widths),
            "scale": _hex(sight.targets.scale),
        },
        "frames": {"camera": _motion(sight.frames.camera), "target": _motion(sight.frames.target)},
    }


def digest_of(inputs: dict[str, Any]) -> str:
    """SHA-256 of the canonical JSON: keys sorted, no white space."""
    text = json.dumps(inputs, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def write_claim(
    stem: Path,
    inputs: dict[str, Any],
    outliers: int,
    found: PoseBox | Pose,
    refuted: bool,
    chains: Sequence[Sequence[tuple[str, int, Sequence[StageRow]]]],
) -> None:
    """The claim beside its certificates; a pose is the centre of the proofs where all poses are refuted."""
    radii = (found.position.mag, 2.0 * found.half_turn.mag) if isinstance(found, PoseBox) else (None, None)
    center = found.center if isinstance(found, PoseBox) else found
    claim = {
        "format": POSE_SET_FORMAT,
        "inputs": inputs,
        "outliers": outliers,
        "refuted": refuted,
        "pose": _motion(center),
        "position_radius": None if radii[0] is None else _hex(radii[0]),
        "rotation_radius": None if radii[1] is None else _hex(radii[1]),
        "chains": [
            [
                {"certificate": file, "power": power, "rows": [[r.dot, r.side, _hex(r.x), _hex(r.y)] for r in rows]}
                for file, power, rows in one
            ]
            for one in chains
        ],
    }
    write_file(stem.with_name(stem.name + SUFFIX), (json.dumps(claim, separators=(",", ":")) + "\n").encode("ascii"))


def _motion(pose: Pose) -> Any:
    return _hex(np.concatenate([pose.position, pose.quaternion]))


def _hex(values: npt.ArrayLike) -> Any:
    """Floats as texts, in lists as in the array."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        return float(array).hex()
    return [_hex(part) for part in array]


_PASSES = 6
_PAYS = 0.95
_PAYS_AGAIN = 0.8  # a further certificate is made where some width shrinks below this share
_STAGES = 3  # of poses about the centre, at most
_GROUPS = {0: 0, 1: 6, 2: 6, 3: 7}  # by outliers: 1, 6, 15 and 35 chains

Stage = tuple[str, int, list[StageRow]]  # a certificate's file, the power of two that its rows have, what they are


@dataclass(frozen=True)
class _Record:
    """Where certificates go: `stem`, a path without its ends, and what each says it is about."""

    stem: Path
    digest: str
    contractor: Callable[[ConstraintNetwork], Contractor]
    written: list[Path]

    def proved(self, network: ConstraintNetwork) -> tuple[Path, Indices, Box] | None:
        """The certificate of what the contractors leave of a network, the rows that it is of, and what is left.

        None when they can do nothing with it.
        """
        steps = Repeat(self.contractor(network), _PAYS, _PASSES).contract(network.domain).steps
        used = np.array(sorted({k for step in steps for c, k in step.rows if c == 0}), dtype=np.intp)
        if not len(used):
            return None
        others = [np.arange(1, dtype=np.intp)] * (len(network.constraints) - 1)
        network = restricted(network, [used, *others])
        named = [("", self.contractor(network))]
        if not Contracting(named).gives_weights:
            raise ModelError("no certificate: the contractors give no weights; use lifted")
        domain, path = network.domain, Path(f"{self.stem}.{len(self.written) + 1}.cert.jsonl")
        with Recording(network_statement(network, None, self.digest), domain) as recording:
            never = LargestFirst(skip=domain.names)  # no box is divided: another pass while some width shrinks
            search = Search([domain], Divide(Contracting(named, recording.prover), never, again=_PAYS))
            for event in islice(search, _PASSES):
                recording.event(event)
            boxes = [node.box for node in search.pending] + [piece.box for piece in search.kept]
            left = boxes[0] if boxes else Box.empty(domain.names)
            hull = None if left.is_empty else limits(left)
            claims = {"cap": None, "infeasible": left.is_empty, "epsilon": None, "enclosure": hull, "point": None}
            recording.write(path, claims)
        self.written.append(path)
        return path, used, left


def write_certificate(
    stem: str | Path, view: View, found: Found, outliers: int, sources: Mapping[str, bytes] | None = None
) -> Found:
    """Prove what was found once more, in writing: a box that is proved by certificates, a little wider than `found`.

    Nothing is written when nothing was found. Raises InputError for too many outliers, ModelError when the contractors
    give no weights, or when no certificate of what was found could be made; then no file is left.
    """
    if isinstance(found, str):
        return found
    if outliers not in _GROUPS:
        remedy = f"ask for at most {max(_GROUPS)}, or for no certificate"
        raise InputError([Problem("certificate", f"none can be written for {outliers} outliers", remedy)])
    center = _center(view, found)
    inputs = inputs_of(view.sight, Path(stem).name, sources or {})
    record = _Record(Path(stem), f"cpcal pose set {digest_of(inputs)}", view.contractor, [])
    try:
        chains = [_chain(record, view, center, chosen) for chosen in _choices(view, outliers)]
        hull = _hull([left for _, left in chains], center)
        if (hull is None) != (found is None):
            raise ModelError("no certificate: the rows in their rounded form do not exclude all poses")
        hull = hull and view.sight.with_scale(hull)
    except BaseException:
        for path in record.written:
            path.unlink(missing_ok=True)
        raise
    write_claim(Path(stem), inputs, outliers, hull or center, hull is None, [stages for stages, _ in chains])
    return hull


def _center(view: View, found: PoseBox | None) -> Pose:
    """About which poses are proved: the middle of what was found, or anything near where all are refuted."""
    if found is not None:
        return found.center
    start = first_box(view)
    return start.center if isinstance(start, PoseBox) else Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def _choices(view: View, outliers: int) -> list[Indices]:
    """The dots of each chain."""
    if not outliers:
        return [np.arange(len(view.sight))]
    groups = groups_of(view.sight.dots, _GROUPS[outliers], 0)
    kept = itertools.combinations(range(len(groups)), len(groups) - outliers)
    return [np.sort(np.concatenate([groups[k] for k in some])) for some in kept]


def _chain(record: _Record, view: View, center: Pose, chosen: Indices) -> tuple[list[Stage], PoseBox | None]:
    """The certificates of some dots, and what they leave."""
    part = view.part(chosen)
    seen = part.sight.anywhere()
    if isinstance(seen, str):
        raise ModelError(f"no certificate: {seen}")
    found = record.proved(motion_rows(part.sight, seen).network())
    motions = "nothing bounded is known" if found is None else None if found[2].is_empty else motions_of(found[2])
    if found is None or isinstance(motions, str):
        raise ModelError(f"no certificate: {motions}")
    stages = [_stage(found[0], 0, found[1], SIDES, chosen, seen.rays)]
    if motions is None:
        return stages, None
    return _narrowed(record, part, center, chosen, motions, stages)


def _narrowed(
    record: _Record, part: View, center: Pose, chosen: Indices, motions: Motions, stages: list[Stage]
) -> tuple[list[Stage], PoseBox | None]:
    """What is left of motions about the centre, stage by stage."""
    start = pose_box(part.sight.frames.mobile_in_base(motions), center)
    if start is None:
        raise ModelError("no certificate: the proof cannot be repeated about the centre of the set")
    unknowns = start.unknowns
    box = start.with_unknowns(unknowns)
    for _ in range(_STAGES):
        seen = part.sight.about(box)
        if isinstance(seen, str):
            raise ModelError(f"no certificate: {seen}")
        rows = pose_rows(part.sight, seen, box, unknowns)
        found = record.proved(rows.network(unknowns))
        if found is None:
            break
        path, used, left = found
        stages.append(_stage(path, rows.power, used, 4, chosen, seen.rays))
        if left.is_empty:
            return stages, None
        before, unknowns = unknowns.width, Box(unknowns.names, left.lo[:6], left.hi[:6])
        box = box.with_unknowns(unknowns)
        if not (unknowns.width < _PAYS_AGAIN * before).any():
            break
    return stages, box


def _stage(path: Path, power: int, used: Indices, sides: int, chosen: Indices, rays: Floats) -> Stage:
    rows = []
    for k in used.tolist():
        x, y = rays[k // sides].tolist()
        rows.append(StageRow(int(chosen[k // sides]), k % sides, x, y))
    return path.name, power, rows


def _hull(left: Sequence[PoseBox | None], center: Pose) -> PoseBox | None:
    """About the centre; None where nothing is left."""
    boxes = [box for box in left if box is not None]
    if not boxes:
        return None
    position, turn = boxes[0].position, boxes[0].half_turn
    for box in boxes[1:]:
        position, turn = position.hull(box.position), turn.hull(box.half_turn)
    return PoseBox(center, position, turn)
