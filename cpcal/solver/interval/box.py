"""A named box: what is known of the variables of a network. Immutable, so that searches may share it."""

from __future__ import annotations

import math
import reprlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from operator import le
from typing import Any, ClassVar, NoReturn, Protocol, TypeAlias, overload

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import ArrayLike, ArrayPair, Bools, Floats, Names, Numbers, Shape, fill
from cpcal.solver.interval.numbers import (
    HasBounds,
    Interval,
    IntervalArray,
    Number,
    float_bounds,
    format_bound,
    round_down,
    round_up,
)

_ONE_LINE = 3  # up to this many variables a box is printed on one line


class Variable(Protocol):
    """What a network's `variable` returns, as far as a box looks at it."""

    @property
    def name(self) -> str: ...
    @property
    def shape(self) -> Shape: ...


def _once(name: str) -> cached_property[Floats]:
    """What follows from the bounds of a box, made once and read-only: one pass over it asks for it several times."""

    def made(box: HasBounds) -> Floats:
        values: Floats = getattr(HasBounds, name).fget(box)
        values.flags.writeable = False
        return values

    return cached_property(made)


class Box(HasBounds):
    """A product of closed intervals with a name each. Bounds are float64, rounded outward where they come in.

    A box with one empty component has no point: it is *the* empty box of its names, all bounds NaN. Equality
    and hash go by names and bounds. `lo` and `hi` are read-only arrays; `mid` is a point of the box near its middle.
    """

    names: Names
    mid, rad, width = map(_once, ("mid", "rad", "width"))

    def __init__(self, names: Sequence[str], lo: ArrayLike, hi: ArrayLike) -> None:
        """NaN in both bounds is an empty component. ModelError for lo > hi, bad or repeated names, bad shapes."""
        if isinstance(names, str):
            raise ModelError(f"{names!r} are not names: give a sequence of strings")
        names = tuple(map(checked_name, names))
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise ModelError(f"variables need different names; repeated: {', '.join(repeated)}")
        lower, upper = _bounds(lo, hi, len(names))
        wrong = ~has_points(lower, upper) & ~(np.isnan(lower) & np.isnan(upper))
        if wrong.any():
            i = int(np.argmax(wrong))
            raise ModelError(f"{names[i]}: [{lower[i]}, {upper[i]}] is no interval: give lo <= hi, one finite")
        self._set(names, lower, upper)

    def _set(self, names: Names, lo: Floats, hi: Floats) -> None:
        # Adding zero copies, and turns -0.0 into 0.0: equal boxes have equal bits.
        lo, hi = lo + 0.0, hi + 0.0
        if not has_points(lo, hi).all():
            if (np.isnan(lo) != np.isnan(hi)).any():
                raise ModelError("one bound is NaN and the other is not: an operation outside its domain?")
            lo = hi = np.full(len(names), np.nan)
        lo.flags.writeable = hi.flags.writeable = False
        fill(self, names=names, lo=lo, hi=hi)

    @classmethod
    def _raw(cls, names: Names, lo: Floats, hi: Floats) -> Box:
        box = object.__new__(cls)
        box._set(names, lo, hi)
        return box

    @classmethod
    def rows(cls, names: Names, lo: Floats, hi: Floats) -> list[Box]:
        """A box of each row of bounds (B, n), of the names of some box; NaN or lo > hi gives the empty box."""
        lo, hi = lo + 0.0, hi + 0.0
        empty = ~has_points(lo, hi).all(axis=1)
        lo[empty], hi[empty] = np.nan, np.nan
        lo.flags.writeable = hi.flags.writeable = False
        boxes = []
        for lower, upper in zip(lo, hi, strict=True):
            box = object.__new__(cls)
            fill(box, names=names, lo=lower, hi=upper)
            boxes.append(box)
        return boxes

    @staticmethod
    def stacked(boxes: Iterable[Box]) -> IntervalArray:
        """The bounds (B, n) of at least one box, all of the same names."""
        lo, hi = zip(*((box.lo, box.hi) for box in boxes), strict=True)
        return IntervalArray(np.stack(lo), np.stack(hi))

    @classmethod
    def from_dict(cls, bounds: Mapping[str, Interval | Number | tuple[Number, Number]]) -> Box:
        """`Box.from_dict({"x": (0, 1), "y": Interval(2, 3), "z": 4})`."""
        intervals = [_interval(name, value) for name, value in bounds.items()]
        return cls(tuple(bounds), [i.lo for i in intervals], [i.hi for i in intervals])

    @classmethod
    def empty(cls, names: Sequence[str]) -> Box:
        """The box without points."""
        if not names:
            raise ModelError("a box without variables is never empty: it has one point")
        nan = np.full(len(names), np.nan)
        return cls(names, nan, nan)

    # In a file; an empty one has no bounds.
    JSON: ClassVar[Mapping[str, Any]] = {
        "names": Names,
        "lo": Numbers | None,
        "hi": Numbers | None,
    }

    def as_json(self) -> dict[str, Any]:
        lo, hi = (None if self.is_empty else side.tolist() for side in (self.lo, self.hi))
        return {"names": self.names, "lo": lo, "hi": hi}

    @classmethod
    def from_json(cls, where: str, names: Names, lo: Numbers | None, hi: Numbers | None) -> Box:
        """Raises ValueError, which says `where`, and ModelError."""
        if lo is None and hi is None:
            return cls.empty(names)
        if lo is None or hi is None or not len(names) == len(lo) == len(hi) or not all(map(le, lo, hi)):
            raise ValueError(f"{where} is no box: lo and hi do not match, or cross")
        return cls(names, lo, hi)

    def __setattr__(self, name: str, value: object = None) -> None:
        raise AttributeError(f"a Box is immutable: use replace() or with_bounds(), {name!r} stays as it is")

    __delattr__ = __setattr__

    def __reduce__(self) -> tuple[Any, ...]:
        return Box._raw, (self.names, self.lo, self.hi)

    @property
    def array(self) -> IntervalArray:
        """The bounds as an engine takes them."""
        return IntervalArray(self.lo, self.hi)

    @property
    def is_empty(self) -> bool:
        return len(self.lo) > 0 and math.isnan(self.lo[0])

    @property
    def is_bounded(self) -> bool:
        """Whether no bound is infinite; the empty box is bounded."""
        return not (np.isinf(self.lo).any() or np.isinf(self.hi).any())

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __bool__(self) -> NoReturn:
        raise TypeError("a box has no truth value: test .is_empty, len(box) or `point in box`")

    def index(self, name: str) -> int:
        """The position of a variable."""
        try:
            return self.names.index(name)
        except ValueError:
            raise ModelError(f"no variable {name!r}; there are {', '.join(self.names)}") from None

    @overload
    def __getitem__(self, name: str) -> Interval: ...
    @overload
    def __getitem__(self, name: Variable) -> Interval | IntervalArray: ...
    def __getitem__(self, name: str | Variable) -> Interval | IntervalArray:
        """Of a component by its name; of a variable all components, in its shape."""
        if not isinstance(name, str):
            if getattr(name, "op", "") != "variable":
                raise ModelError(f"a box is asked for a component's name or for a variable, not for {name!r}")
            if name.shape:
                where = np.array([self.index(one) for one in component_names(name)]).reshape(name.shape)
                return IntervalArray(self.lo[where], self.hi[where])
            name = name.name
        i = self.index(name)
        return Interval.empty() if self.is_empty else Interval(float(self.lo[i]), float(self.hi[i]))

    def replace(self, name_or_index: str | int, lo: Number | None = None, hi: Number | None = None) -> Box:
        """A box with another lower or upper bound (or both) of one variable; lo > hi gives the empty box."""
        i = self.index(name_or_index) if isinstance(name_or_index, str) else name_or_index
        if self.is_empty:
            return self
        lower, upper = self.lo.copy(), self.hi.copy()
        if lo is not None:
            lower[i] = round_down(lo)
        if hi is not None:
            upper[i] = round_up(hi)
        return Box._raw(self.names, lower, upper)

    def with_bounds(self, lo: ArrayLike, hi: ArrayLike) -> Box:
        """A box of the same names with these bounds; lo > hi or NaN anywhere gives the empty box."""
        return Box._raw(self.names, *_bounds(lo, hi, len(self)))

    def _same_names(self, other: Box) -> None:
        if not isinstance(other, Box):
            raise TypeError(f"{other!r} is no box")
        if self.names != other.names:
            raise ModelError(f"boxes of different variables: {list(self.names)} and {list(other.names)}")

    def intersect(self, other: Box | IntervalArray) -> Box:
        """The points in both, `&` for short; or those within other bounds (n,), none where some are NaN."""
        if not isinstance(other, IntervalArray):
            self._same_names(other)
        return Box._raw(self.names, np.maximum(self.lo, other.lo), np.minimum(self.hi, other.hi))

    def hull(self, other: Box) -> Box:
        """The smallest box that contains both; `|` for short. The empty box is neutral."""
        self._same_names(other)
        return Box._raw(self.names, np.fmin(self.lo, other.lo), np.fmax(self.hi, other.hi))

    __and__, __or__ = intersect, hull

    def subset(self, other: Box) -> bool:
        """Whether every point of this box is one of other; the empty box lies in all."""
        self._same_names(other)
        return self.is_empty or bool(((self.lo >= other.lo) & (self.hi <= other.hi)).all())

    def __contains__(self, point: Mapping[str, Number] | Sequence[Number] | Floats) -> bool:
        """Whether a point lies inside: values by name, or in the order of the names."""
        if isinstance(point, Mapping):
            missing = [name for name in self.names if name not in point]
            if missing:
                raise ModelError(f"the point gives no value for {', '.join(missing)}")
            point = [point[name] for name in self.names]
        if isinstance(point, str) or len(point) != len(self):
            raise ModelError(f"{point!r} is no point of {len(self)} variables; for names use `in box.names`")
        return not self.is_empty and all(x in self[name] for name, x in zip(self.names, point, strict=True))

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, Box) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[Names, bytes, bytes]:
        return self.names, self.lo.tobytes(), self.hi.tobytes()

    def __repr__(self) -> str:
        if self.is_empty:
            return f"Box.empty({list(self.names)!r})"
        pairs = zip(self.names, self.lo, self.hi, strict=True)
        items = [f"{n!r}: ({format_bound(lo)}, {format_bound(hi)})" for n, lo, hi in pairs]
        joined = ", ".join(items) if len(items) <= _ONE_LINE else "\n    " + ",\n    ".join(items) + ",\n"
        return f"Box.from_dict({{{joined}}})"

    def __str__(self) -> str:
        """One line per variable (one line in all for a few)."""
        if self.is_empty:
            return f"empty box of {', '.join(self.names)}"
        if len(self) <= _ONE_LINE:
            return ", ".join(f"{name} in {self[name]}" for name in self.names)
        longest = max(map(len, self.names))
        return "\n".join(f"{name:<{longest}} in {self[name]}" for name in self.names)


Boxes: TypeAlias = tuple[Box, ...]


def component_names(variable: Variable) -> Names:
    """`x` for a scalar, `x[0]`, `x[1]` or `x[0,1]` for the components of an array."""
    if variable.shape == ():
        return (variable.name,)
    return tuple(f"{variable.name}[{','.join(map(str, index))}]" for index in np.ndindex(variable.shape))


def checked_name(name: object) -> str:
    """The name of a variable, which is printed as it is: visible characters, no space at its ends. ModelError."""
    if not isinstance(name, str) or not name.isprintable() or name != name.strip() or not name:
        raise ModelError(f"{name!r} is no name: give a string of printable characters without spaces at its ends")
    return name


def has_points(lo: Floats, hi: Floats) -> Bools:
    """Which components contain a real number."""
    return (lo <= hi) & (lo < np.inf) & (hi > -np.inf)


def _interval(name: str, value: Interval | Number | tuple[Number, Number]) -> Interval:
    if isinstance(value, Interval):
        return value
    try:
        lo, hi = value if isinstance(value, Sequence) and not isinstance(value, str) else (value, value)
        return Interval(round_down(lo), round_up(hi))
    except (ModelError, ValueError) as error:
        raise ModelError(f"{name}: {error}") from error


def _bounds(lo: ArrayLike, hi: ArrayLike, count: int) -> ArrayPair:
    """The float64 bounds below some numbers and above others, in arrays of any owner."""
    lower, upper = float_bounds(lo)[0], float_bounds(hi)[1]
    if not lower.shape == upper.shape == (count,):
        given = f"{lower.shape} and {upper.shape}, not {reprlib.repr(lo)} and {reprlib.repr(hi)}"
        raise ModelError(f"{count} variables, but bounds of shapes {given}: give a list or 1-D array of each")
    return lower, upper
