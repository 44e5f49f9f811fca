"""Frozen dataclasses as JSON and back: one codec for all of cpcal's own files.

What is read is checked: every field there, none besides, each of its type; what the types cannot say, a class says in
its `__post_init__` by ValueError or InputError. A field's name in the file is its own, or `json` of its annotation.
JSON has no NaN and no infinities: they are the strings "nan", "inf" and "-inf". A class that is no dataclass says
what it is in a file: its keys and their types (`JSON`), `as_json` and `from_json`.

A field of a file that `cpcal verify` reads says in its type how it is checked: `Annotated[..., checked(...)]`, or
`Informed[...]`, and then it stands under the key "information" of its object. What is checked by a certificate or other
proofs stands there too where these are missing: a number beside them, and without them, is refused.
"""

import json
import math
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cpcal.common.documents import json_object
from cpcal.common.errors import CpcalError, InputError, shown, unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.values import Json

T = TypeVar("T")

INFORMATION = "information"  # the key, and how it is checked: not at all
_NUMBERS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


def checked(how: str, *by: str, json: str | None = None) -> Json:
    """The annotation of a field: `how` it is checked, `by` which other fields, that hold proofs; `json`: its key."""
    return {"checked": how, "by": by} | ({} if json is None else {"json": json})


Informed = Annotated[T, checked(INFORMATION)]


@dataclass(frozen=True)
class Document(Generic[T]):
    """The file of a dataclass in a folder: its name, its format, and the `remedy` where it cannot be read."""

    kind: type[T]
    name: str
    format: str
    remedy: str

    def save(self, value: T, folder: StrPath) -> Path:
        """Write the file into the folder (made if missing), all or nothing; its path. Raises InputError."""
        data = {"format": self.format, **encoded(value)}
        text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        return write_file(Path(folder) / self.name, text)

    def load(self, folder: StrPath) -> T:
        """Read the file in the folder. Raises InputError."""
        path = Path(folder) / self.name
        data = json_object(path, self.remedy, self.remedy)
        if data.pop("format", None) != self.format:
            raise unusable(path, f"is not of format {self.format}", self.remedy)
        try:
            return cast(T, decoded(self.kind, data))
        except (ValueError, CpcalError) as error:
            reason = error.problems[0].what if isinstance(error, InputError) else error
            raise unusable(path, f"lacks or garbles a field: {reason}", self.remedy) from None


def encoded(value: Any) -> Any:
    """A value of JSON."""
    if type(value) is str or type(value) is int:  # most are plain
        return value
    if is_dataclass(value) and not isinstance(value, type):
        layout = layout_of(type(value))
        named = {key for part in layout for key in part.by}
        proved = {part.key for part in layout if part.key in named and getattr(value, part.name)}
        parts = [(part, encoded(getattr(value, part.name))) for part in layout]
        beside = {part.key: found for part, found in parts if part.is_beside(proved)}
        others = {part.key: found for part, found in parts if not part.is_beside(proved)}
        return beside | ({INFORMATION: others} if any(part.how == INFORMATION or part.by for part in layout) else {})
    if hasattr(value, "as_json"):
        return encoded(value.as_json())
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): encoded(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        if all(type(part) is float and math.isfinite(part) for part in value):
            return list(value)
        return [encoded(part) for part in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else str(float(value))
    return value


def decoded(kind: Any, value: Any, where: str = "it") -> Any:
    """A value of JSON as a dataclass, tuple, Mapping, Enum, Box, None, float, int, bool or str. Raises ValueError."""
    if type(kind) is type and kind in _WORDS:  # most are plain
        return _plain(kind, value, where)
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return (
            None
            if value is None and type(None) in parts
            else decoded(next(part for part in parts if part is not type(None)), value, where)
        )
    if is_dataclass(kind):
        return _dataclass(kind, value, where)
    if origin is tuple:
        return _tuple(parts, value, where)
    if origin is not None and issubclass(origin, Mapping):
        return {key: decoded(parts[1], part, f"{where}.{shown(key)}") for key, part in _object(value, where).items()}
    if hasattr(kind, "from_json"):
        found = _object(value, where)
        if found.keys() != kind.JSON.keys():
            raise ValueError(f"{where} is no {kind.__name__}: {', '.join(kind.JSON)}")
        given = {key: decoded(of, found[key], f"{where}.{key}") for key, of in kind.JSON.items()}
        return kind.from_json(where, **given)
    if value not in [member.value for member in kind]:  # an Enum
        raise ValueError(f"{where} is none of {', '.join(str(member.value) for member in kind)}")
    return kind(value)


class _Field(NamedTuple):
    """A field of a dataclass: its key, its type, how it is checked, and the keys of what proves it."""

    name: str
    key: str
    kind: Any
    how: str
    by: tuple[str, ...]

    def is_beside(self, proved: set[str]) -> bool:
        """Whether it stands outside of the information, where these keys hold something."""
        return self.how != INFORMATION and (not self.by or not proved.isdisjoint(self.by))


@cache
def layout_of(kind: type) -> tuple[_Field, ...]:
    kinds, names = get_type_hints(kind), [field.name for field in fields(kind)]
    hints = get_type_hints(kind, include_extras=True)
    said: dict[str, Mapping[str, Any]] = {name: getattr(hints[name], "__metadata__", ({},))[0] for name in names}
    keys = {name: said[name].get("json", name) for name in names}
    return tuple(
        _Field(name, keys[name], kinds[name], how.get("checked", ""), tuple(keys[other] for other in how.get("by", ())))
        for name, how in said.items()
    )


def _dataclass(kind: Any, value: Any, where: str) -> Any:
    layout, found = layout_of(kind), dict(_object(value, where))
    proved = {key for key, part in found.items() if part}
    places = [(found, where, [part for part in layout if part.is_beside(proved)])]
    if any(part.how == INFORMATION or part.by for part in layout):
        others = [part for part in layout if not part.is_beside(proved)]
        alone = [part.key for part in others if part.by and part.key in found]
        if alone:
            raise ValueError(f"{where} states {', '.join(alone)} without a proof")
        if INFORMATION not in found:
            raise ValueError(f"{where} lacks {INFORMATION}")
        under = INFORMATION if where == "it" else f"{where}.{INFORMATION}"
        places.append((_object(found.pop(INFORMATION), under), under, others))
    values: Json = {}
    for given, at, parts in places:
        keys = {part.key for part in parts}
        if given.keys() != keys:
            missing, unknown = sorted(keys - given.keys()), sorted(map(shown, given.keys() - keys))
            said = [f"lacks {', '.join(missing)}"] if missing else []
            said += [f"has {', '.join(unknown[:5])}, which mean nothing"] if unknown else []
            raise ValueError(f"{at} {' and '.join(said)}")
        inner = "" if at == "it" else f"{at}."
        values |= {part.name: decoded(part.kind, given[part.key], f"{inner}{part.key}") for part in parts}
    return kind(**values)


def _tuple(parts: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{where} is no list")
    kinds = [parts[0]] * len(value) if parts[-1] is Ellipsis else list(parts)
    if len(kinds) != len(value):
        raise ValueError(f"{where} is no list of {len(kinds)}")
    if all(type(part) is of and of in _WORDS for of, part in zip(kinds, value, strict=True)):
        return tuple(value)
    return tuple(decoded(of, part, f"{where}[{k}]") for k, (of, part) in enumerate(zip(kinds, value, strict=True)))


def _plain(kind: Any, value: Any, where: str) -> Any:
    if kind is float and isinstance(value, str) and value in _NUMBERS:
        return _NUMBERS[value]
    allowed = (int, float) if kind is float else kind
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{where} is no {_WORDS[kind]}")
    return kind(value)


_WORDS = {float: "number", int: "whole number", bool: "true or false", str: "text"}


def _object(value: Any, where: str) -> Json:
    if not isinstance(value, dict):
        raise ValueError(f"{where} is no object")
    return value
