"""Types of numpy arrays, for the whole package."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]
Bools: TypeAlias = npt.NDArray[np.bool_]
Indices: TypeAlias = npt.NDArray[np.intp]
Ints: TypeAlias = npt.NDArray[np.int64]

_REAL = "fiuSUO"  # kinds of numpy arrays that a user's real numbers come in; texts and objects are parsed


def as_floats(values: npt.ArrayLike) -> Floats:
    """What a user gives as real numbers. Raises TypeError or ValueError for anything else.

    numpy would take what stands under a mask, a complex number without its imaginary part, and true as 1.
    """
    parts = (values, *values) if isinstance(values, list | tuple) else (values,)
    if any(np.ma.is_masked(part) for part in parts):
        raise TypeError("some values are masked")
    array = np.asarray(values)
    if array.dtype.kind not in _REAL:
        raise TypeError(f"values of the type {array.dtype} are no real numbers")
    return array.astype(np.float64, copy=False)
