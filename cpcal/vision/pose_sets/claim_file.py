"""NAME.pose.json: what a pose set assumes and claims, in exact numbers (docs/certificate-format.md)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cpcal.common.atomic import write_file
from cpcal.robot import Pose
from cpcal.vision.pose_sets.field_of_view import field_of_view
from cpcal.vision.pose_sets.pose_box import PoseBox
from cpcal.vision.pose_sets.sight import Sight

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
