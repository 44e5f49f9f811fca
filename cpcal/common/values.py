"""Values that hold arrays: dataclasses that nobody can change, compared by what they hold.

    @dataclass(frozen=True, eq=False)
    class Robot(Value):
        def __post_init__(self):
            freeze(self, "base")

Arrays and mappings also stay read-only when a value is copied or unpickled, so that what was computed from one (a
digest) stays true of it.
"""

import sys
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

# ------------------------------------------------------------------------------------------------------------------
# Types of numpy arrays, and of tuples, for the whole package.

ArrayLike: TypeAlias = npt.ArrayLike  # what numpy makes an array of
AnyArray: TypeAlias = npt.NDArray[Any]
Floats: TypeAlias = npt.NDArray[np.float64]
ArrayPair: TypeAlias = tuple[Floats, Floats]
Pair: TypeAlias = tuple[float, float]
Bools: TypeAlias = npt.NDArray[np.bool_]
Indices: TypeAlias = npt.NDArray[np.intp]
Ints: TypeAlias = npt.NDArray[np.int64]
Shape: TypeAlias = tuple[int, ...]
Names: TypeAlias = tuple[str, ...]
Numbers: TypeAlias = tuple[float, ...]
Places: TypeAlias = tuple[int, ...]  # of rows, legs or coordinates among all
Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]  # scalar first
Texts: TypeAlias = Mapping[str, str]  # by name
Json: TypeAlias = dict[str, Any]  # an object of JSON, or values by name

TINY = float(np.finfo(np.float64).tiny)  # below every number that is told from 0
FORTH, BACK = [1, 2, 0], [2, 0, 1]  # of a cross product
LARGEST = 1e12  # mm: no robot is larger, and no square of such a number overflows
_REAL = "fiuSUO"  # kinds of numpy arrays that a user's real numbers come in; texts and objects are parsed


def as_floats(values: ArrayLike) -> Floats:
    """What a user gives as real numbers. Raises TypeError or ValueError for anything else.

    numpy itself would take masked values, drop imaginary parts, and read true as 1.
    """
    parts = (values, *values) if isinstance(values, list | tuple) else (values,)
    if "numpy.ma" in sys.modules and any(np.ma.is_masked(part) for part in parts):
        raise TypeError("some values are masked")
    array = np.asarray(values)
    if array.dtype.kind not in _REAL:
        raise TypeError(f"values of the type {array.dtype} are no real numbers")
    return array.astype(np.float64, copy=False)


_V = TypeVar("_V")


def frozen_array(values: ArrayLike) -> Floats:
    """A private, read-only, C-ordered float64 copy. Raises TypeError or ValueError for what is no real number."""
    array = np.array(as_floats(values), order="C")
    array.setflags(write=False)
    return array


def frozen_mapping(values: Mapping[str, _V]) -> Mapping[str, _V]:
    """A private, read-only copy."""
    return MappingProxyType(dict(values))


def floats(values: ArrayLike) -> Floats:
    """The same in double precision, not copied where it is so already."""
    return np.asarray(values, np.float64)


def all_finite(values: ArrayLike) -> bool:
    """Whether no number among them is infinite or NaN."""
    return bool(np.isfinite(values).all())


def norms(vectors: Floats) -> Floats:
    """Their Euclidean lengths, (..., n) -> (...)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def crossed(x: Floats, y: Floats) -> Floats:
    """The most that the components (..., 3) of a cross product can be, of vectors with components of these sizes."""
    return x[..., FORTH] * y[..., BACK] + x[..., BACK] * y[..., FORTH]


def fill(value: object, **held: object) -> None:
    """Fields of a frozen dataclass, while it is made."""
    for name, field in held.items():
        object.__setattr__(value, name, field)


def freeze(value: object, *names: str) -> None:
    """Fields of a frozen dataclass become private, read-only arrays, while it is made. Raises as `frozen_array`."""
    fill(value, **{name: frozen_array(getattr(value, name)) for name in names})


class ByValue:
    """Base of dataclasses that are equal when their fields are, arrays included."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.compare)  # type: ignore[arg-type]

    def __hash__(self) -> int:
        held = [getattr(self, f.name) for f in fields(self) if f.compare]  # type: ignore[arg-type]
        return hash((type(self), *(_hashable(value) for value in held)))


class Value(ByValue):
    """Base of frozen dataclasses with frozen fields: copies, and what pickles bring back, are made anew of the fields
    and read-only; what else was kept (a cached property) is computed again."""

    def __reduce__(self) -> tuple[Any, ...]:
        given, kept = dict[str, Any](), dict[str, Any]()
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            (given if f.init else kept)[f.name] = dict(value) if isinstance(value, MappingProxyType) else value
        return partial(type(self), **given), (), kept or None


def same(one: object, other: object) -> bool:
    """Whether two fields hold the same, arrays entry by entry."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)  # type: ignore[arg-type]
    return bool(one == other)


def _hashable(value: object) -> object:
    """The same for equal values: arrays by their shape, because 0.0 and -0.0 have other bytes."""
    if isinstance(value, np.ndarray):
        return value.shape
    return len(value) if isinstance(value, Mapping) else value
