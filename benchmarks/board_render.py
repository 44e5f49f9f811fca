"""Rendered boards of black and white cells (ChArUco, AprilTag), with the light and noise of `cpcal.vision.render`.

The plane of the board is seen through the exact inverse: pixel, lens, homography of the pose, cell of the board. A fine
pixel straddles at most one border of cells each way; its share on either side is a ramp as wide as the fine pixel is
across the border (as a blur it has the fine pixel's variance, and being even it leaves the border where it is). Then,
as for dots, the blur is a Gaussian on the fine pixels and an image's pixel is the mean of its fine ones.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from cpcal.common.arrays import Floats
from cpcal.robot import Pose, transformed
from cpcal.vision.camera import Camera
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Image, Scene, exposed

FINE = 4  # fine pixels in a pixel, each way
_REACH = 5.0  # of the blur, in its standard deviations
_NODES = 20  # of the polynomials that carry pixels to cells, each way: some 1e-10 of a cell


@dataclass(frozen=True, eq=False)
class Board:
    """Square cells around the origin of the target frame, in a plane that is bright elsewhere.

    cells     (rows, columns) bool, true where bright; the first row is the uppermost as printed
    cell      its side, mm
    """

    cells: npt.NDArray[np.bool_]
    cell: float

    def on_plate(self, corners: npt.ArrayLike) -> Floats:
        """Points (n, 3) mm of the target frame for (n, >= 2) in cells right and down from the upper left corner."""
        at = np.asarray(corners, dtype=np.float64)
        rows, columns = self.cells.shape
        x, y = (at[:, 0] - 0.5 * columns) * self.cell, (0.5 * rows - at[:, 1]) * self.cell
        return np.stack([x, y, np.zeros_like(x)], axis=1)


def render_board(board: Board, camera: Camera, pose: Pose, scene: Scene, *, seed: int = 0) -> Image:
    """The image (height, width) of the board at `pose` (target in camera frame, mm)."""
    return exposed(bright_share(board, camera, pose, scene.blur), scene, seed=seed)


def bright_share(board: Board, camera: Camera, pose: Pose, blur: float) -> npt.NDArray[np.float32]:
    """Which share of each pixel's light comes from bright surface, blurred: (height, width)."""
    image = np.ones((camera.height, camera.width), dtype=np.float32)
    low, high = _extent(board, camera, pose, int(np.ceil(_REACH * blur)) + 2)
    if (high <= low).any():
        return image
    fine = _fine_share(board, camera, pose, low, high)
    if blur > 0.0:
        width = 2 * int(np.ceil(_REACH * blur * FINE)) + 1
        fine = opencv().GaussianBlur(fine, (width, width), blur * FINE, borderType=opencv().BORDER_REPLICATE)
    (width, height), keep = high - low, (np.maximum(low, 0), np.minimum(high, [camera.width, camera.height]))
    means = fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    (x0, y0), (x1, y1) = keep
    image[y0:y1, x0:x1] = means[y0 - low[1] : y1 - low[1], x0 - low[0] : x1 - low[0]]
    return image


def cells_at(board: Board, camera: Camera, pose: Pose, pixels: npt.ArrayLike) -> Floats:
    """Where on the board pixels (..., 2) look: cells (..., 2) right and down from its upper left corner."""
    rays = camera.normalised(pixels)
    rotation = pose.rotation
    plane = np.linalg.inv(np.stack([rotation[:, 0], rotation[:, 1], pose.position], axis=1))
    on_plane = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ plane.T
    rows, columns = board.cells.shape
    x, y = np.moveaxis(on_plane[..., :2] / on_plane[..., 2:], -1, 0) / board.cell
    return np.stack([x + 0.5 * columns, 0.5 * rows - y], axis=-1)


def _extent(board: Board, camera: Camera, pose: Pose, margin: int) -> tuple[Any, Any]:
    """The pixels (2,) from and (2,) up to which the board reaches with a margin, if the image needs them."""
    rows, columns = board.cells.shape
    along = np.linspace(0.0, 1.0, 33)[:, None]
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows], [0, 0]], dtype=np.float64)
    outline = np.concatenate([a + along * (b - a) for a, b in itertools.pairwise(corners)])
    seen = camera.project(transformed(pose, board.on_plate(outline)))
    low = np.floor(seen.min(axis=0)).astype(np.int64) - margin
    high = np.ceil(seen.max(axis=0)).astype(np.int64) + margin + 1
    return np.maximum(low, -margin), np.minimum(high, np.array([camera.width, camera.height]) + margin)


def _fine_share(board: Board, camera: Camera, pose: Pose, low: Any, high: Any) -> npt.NDArray[np.float32]:
    """The share of bright surface in the fine pixels from pixel `low` up to `high`: (fine rows, fine columns)."""
    nodes = chebyshev.chebpts1(_NODES)
    x, y = (low[k] - 0.5 + 0.5 * (nodes + 1.0) * (high[k] - low[k]) for k in (0, 1))
    at_nodes = np.moveaxis(cells_at(board, camera, pose, np.stack(np.meshgrid(x, y), axis=-1)), -1, 0)
    right, down = (_carried(FINE * n) for n in high - low)
    rows, columns = board.cells.shape
    across, u = _sides(at_nodes[0], down, right, columns)
    below, v = _sides(at_nodes[1], down, right, rows)
    stride = np.int32(columns + 2)
    flat, corner = np.pad(board.cells, 1, constant_values=True).astype(np.float32).ravel(), v * stride + u
    upper, lower = flat[corner], flat[corner + stride]
    upper += (flat[corner + np.int32(1)] - upper) * across
    lower += (flat[corner + (stride + np.int32(1))] - lower) * across
    out: npt.NDArray[np.float32] = upper + (lower - upper) * below
    return out


def _coefficients() -> Floats:
    """(nodes, nodes): from values at the nodes to the coefficients of the Chebyshev polynomial through them."""
    inverse: Floats = np.linalg.inv(chebyshev.chebvander(chebyshev.chebpts1(_NODES), _NODES - 1)).astype(np.float64)
    return inverse


def _carried(count: int) -> Floats:
    """(count, nodes): from values at the nodes to those at the middles of `count` equal parts of [-1, 1]."""
    middles = (2.0 * np.arange(count) + 1.0) / count - 1.0
    carried: Floats = chebyshev.chebvander(middles, _NODES - 1) @ _coefficients()
    return carried


def _sides(
    at_nodes: Floats, down: Floats, right: Floats, count: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """For places across `count` cells: the share of the fine pixel beyond the nearest border, and that border."""
    derived = chebyshev.chebvander(chebyshev.chebpts1(_NODES), _NODES - 2) @ chebyshev.chebder(_coefficients())
    slope = np.hypot(derived @ at_nodes / len(down), at_nodes @ derived.T / len(right)) * 2.0  # cells per fine pixel
    at = (down @ at_nodes @ right.T).astype(np.float32)
    np.clip(at, -0.49, count + 0.49, out=at)  # the border is one of 0 to count
    border = np.rint(at)
    at -= border
    at *= (down @ (1.0 / slope) @ right.T).astype(np.float32)
    at += np.float32(0.5)
    return np.clip(at, 0.0, 1.0, out=at), border.astype(np.int32)
