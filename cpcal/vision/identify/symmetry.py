"""Ways to lay a target onto itself so that many dots cover dots: what an identification may be mistaken for.

A square grid goes over into itself by turns, shifts, shears and reflections; only the dots off the grid tell. These
affine maps are found once for a target: every dot with two of its neighbours is laid onto a few dots with theirs.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cpcal.common.arrays import Floats, Ints
from cpcal.vision.target import Target

_BASES = 12  # dots whose neighbourhoods are laid onto all others
_NEIGHBOURS = 5
_SHARE = 0.5  # of the dots that must cover dots, for a map to be kept
_KEPT = 256


@dataclass(frozen=True, eq=False)
class SelfMaps:
    """Maps S: x -> matrix x + shift, other than the identity, best first.

    matrix (m, 2, 2), shift (m, 2); image (m, n): the dot that S lays dot i on, or -1; mirrored (m,)
    """

    matrix: Floats
    shift: Floats
    image: Ints
    mirrored: npt.NDArray[np.bool_]


@lru_cache(maxsize=8)
def self_maps(target: Target, tolerance: float = 0.25) -> SelfMaps:
    """The maps that lay at least half of the dots onto dots, within `tolerance` of the dots' radius."""
    dots, reach = target.dots, tolerance * target.radius
    tree = cKDTree(dots)
    frames = _frames(dots, tree)
    rng = np.random.default_rng(0)
    bases = frames[rng.permutation(len(frames))[:_BASES]]
    start = _matrices(dots, bases)  # (B, 2, 2), columns are the two edges
    goal = _matrices(dots, frames)
    matrix = (goal[None] @ np.linalg.inv(start)[:, None]).reshape(-1, 2, 2)
    turned = matrix.reshape(len(bases), -1, 2, 2) @ dots[bases[:, 0]][:, None, :, None]
    shift = (dots[frames[:, 0]] - turned[..., 0]).reshape(-1, 2)
    trial = dots[rng.permutation(len(dots))[:16]]
    promising = _images(tree, trial, matrix, shift, reach)
    keep = (promising >= 0).mean(axis=1) >= 0.4
    matrix, shift = matrix[keep], shift[keep]
    image = _images(tree, dots, matrix, shift, reach)
    share = (image >= 0).mean(axis=1)
    identity = (image == np.arange(len(dots))).mean(axis=1) > 0.5
    matrix, shift, image, share = (a[(share >= _SHARE) & ~identity] for a in (matrix, shift, image, share))
    _, first = np.unique(image, axis=0, return_index=True)
    best = first[np.argsort(-share[first], kind="stable")][:_KEPT]
    return SelfMaps(matrix[best], shift[best], image[best], np.linalg.det(matrix[best]) < 0.0)


def _frames(dots: Floats, tree: cKDTree) -> Ints:
    """A dot and two neighbours not in line with it: (f, 3)."""
    count = min(_NEIGHBOURS + 1, len(dots))
    near = np.asarray(tree.query(dots, k=count)[1], dtype=np.int64)[:, 1:]
    both = itertools.permutations(range(count - 1), 2)
    frames = np.concatenate([np.stack([np.arange(len(dots)), near[:, a], near[:, b]], axis=1) for a, b in both])
    edges = _matrices(dots, frames)
    lengths = np.linalg.norm(edges, axis=1)
    return np.asarray(frames[np.abs(np.linalg.det(edges)) > 0.3 * lengths[:, 0] * lengths[:, 1]])


def _matrices(dots: Floats, frames: Ints) -> Floats:
    return np.stack([dots[frames[:, 1]] - dots[frames[:, 0]], dots[frames[:, 2]] - dots[frames[:, 0]]], axis=2)


def _images(tree: cKDTree, points: Floats, matrix: Floats, shift: Floats, reach: float) -> Ints:
    """Which dot each map lays each point on, (m, points), -1 for none."""
    moved = np.einsum("mij,nj->mni", matrix, points) + shift[:, None, :]
    away, nearest = tree.query(moved.reshape(-1, 2), distance_upper_bound=reach)
    found = np.where(np.isfinite(away), nearest, -1)
    return np.asarray(found, dtype=np.int64).reshape(len(matrix), len(points))
