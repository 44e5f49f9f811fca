"""Vectors and matrices of Minibex: put together from parts, and taken apart by indices.

A column vector has one axis, a row vector two: (1, n). An array of matrices has three.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.problems.minibex_values import Array, Value, array_of

Place = int | slice  # from 0


def stacked(parts: list[Value], row: bool) -> Array:
    """(a, b) or (a; b): of numbers a vector, of vectors and matrices a matrix. Raises ModelError where none fits.

    Numbers, and rows where columns stand, count as matrices. Matrices of one shape, one below the other, are an array
    of matrices.
    """
    if not any(isinstance(part, np.ndarray) for part in parts):
        return array_of(list(parts), (1, len(parts)) if row else (len(parts),))
    blocks = [_matrix(part) for part in parts]
    shapes = {block.shape for block in blocks}
    if not row and len(shapes) == 1 and all(side > 1 for side in blocks[0].shape):
        return np.stack(blocks)
    if len({block.shape[0 if row else 1] for block in blocks}) > 1:
        raise ModelError(f"parts of the shapes {', '.join(map(str, sorted(shapes)))} do not fit together")
    return flattened(np.concatenate(blocks, axis=1 if row else 0))


def _matrix(value: Value) -> Array:
    if not isinstance(value, np.ndarray):
        return array_of([value], (1, 1))
    if value.ndim == 3:
        raise ModelError("an array of matrices stands in a matrix")
    return value[:, None] if value.ndim == 1 else value


def flattened(matrix: Array) -> Array:
    """A matrix of one column as a vector."""
    return matrix[:, 0] if matrix.ndim == 2 and matrix.shape[1] == 1 else matrix


def indexed(array: Array, places: tuple[Place, ...]) -> Value:
    """One number, or the part of an array: a row of a matrix is a row, and one index of a row is a number."""
    if len(places) == 1 and is_row(array):
        places = (0, *places)
    kept = tuple(slice(p, p + 1) if isinstance(p, int) and array.ndim == 2 else p for p in places)
    found: Any = array[kept]
    if len(places) == array.ndim and all(isinstance(p, int) for p in places):
        return np.ravel(found)[0] if isinstance(found, np.ndarray) else found  # type: ignore[no-any-return]
    return flattened(found)


def is_row(array: Array) -> bool:
    return array.ndim == 2 and array.shape[0] == 1
