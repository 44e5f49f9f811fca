"""Every key of every file that `cpcal verify` reads, and what changes of them are accepted."""

import json
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

from cpcal.checker.files import ACCURACY_NAME, HAND_EYE_NAME
from cpcal.common.codec import INFORMATION, layout_of
from cpcal.questions import RESULT_NAME, Result
from cpcal.questions.accuracy import Accuracy
from cpcal.questions.hand_eye import HandEyeResult

FILES = {RESULT_NAME: Result, ACCURACY_NAME: Accuracy, HAND_EYE_NAME: HandEyeResult}
Path_ = tuple[str | int, ...]


def accepted_changes(file, verified, but="", *, thorough=False):
    """Keys of a JSON file that stand outside of the information (and of the key `but`), and an accepted change.

    A key is changed in the last place that has it, in one way of three by turns; `thorough`: everywhere, in each.
    """
    text = file.read_text(encoding="utf-8")
    places = [path for path in _places(json.loads(text)) if path[0] != but]
    try:
        for k, path in enumerate(places if thorough else {key_of(path): path for path in places}.values()):
            others = _changes(_at(json.loads(text), path))
            for other in others if thorough else [others[k % 3]]:
                data = json.loads(text)
                _at(data, path[:-1])[path[-1]] = other
                file.write_text(json.dumps(data), encoding="utf-8")
                if verified():
                    yield f"{key_of(path)}: {json.dumps(_at(json.loads(text), path))[:60]} to {json.dumps(other)[:60]}"
    finally:
        file.write_text(text, encoding="utf-8")


def unlisted_keys(file: Path) -> list[str]:
    """Keys of a JSON file outside of the information that the dataclass of the file does not have."""
    rows = ["format", *(key for key, _ in keys_of(FILES[file.name]))]
    data = json.loads(file.read_text(encoding="utf-8"))
    values = {key_of(path) for path in _places(data) if not isinstance(_at(data, path), dict | list)}
    return sorted(key for key in values if not any(_within(key, row) or _within(row, key) for row in rows))


def keys_of(kind: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every key of the file of a dataclass, and how it is checked. Raises TypeError for one that does not say it."""
    for part in layout_of(kind):
        if part.how == INFORMATION:
            yield f"{prefix}{INFORMATION}.{part.key}", INFORMATION
            continue
        inner, key = part.kind, prefix + part.key
        while not is_dataclass(inner) and get_args(inner):
            key += "[]" if get_origin(inner) is tuple else ""
            inner = next(of for of in get_args(inner) if of is not type(None))
        if part.how:
            without = f"; without {' and '.join(part.by)} under {INFORMATION}" if part.by else ""
            yield key, part.how + without
        elif is_dataclass(inner):
            yield from keys_of(inner, f"{key}.")
        else:
            raise TypeError(f"{key} does not say how it is checked")


def _within(key: str, other: str) -> bool:
    return key == other or key.startswith((f"{other}.", f"{other}["))


def key_of(path: Path_) -> str:
    """As `keys_of` has it."""
    return re.sub(r"\.\[", "[", ".".join("[]" if isinstance(part, int) else part for part in path))


def _places(value: Any, at: Path_ = ()) -> Iterator[Path_]:
    """Objects, lists and values, the first and the last one of a list; nothing of the information."""
    if at and at[-1] == INFORMATION:
        return
    if at:
        yield at
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _places(part, (*at, key))
    if isinstance(value, list):
        for k in sorted({0, len(value) - 1} & set(range(len(value)))):
            yield from _places(value[k], (*at, k))


def _at(data: Any, path: Path_) -> Any:
    for part in path:
        data = data[part]
    return data


def _changes(value: Any) -> list[Any]:
    """Three other values: where there are such, two of its own kind."""
    if isinstance(value, bool):
        return [not value, int(value), None]
    if isinstance(value, int | float):
        return [value + (0.001 * abs(value) or 1), value - (0.001 * abs(value) or 1), str(value)]
    if isinstance(value, str) and value.lstrip("-").startswith("0x"):
        return ["0x11p+3", "-0x11p+3", 7]
    if isinstance(value, str):
        return [value[:-1] + ("1" if value[-1:] != "1" else "2"), f"{value}x", 7]
    if isinstance(value, list):
        return [value[:-1] if value else [0], [*value, *value[-1:]] if value else {}, None]
    return [{}, 1, []] if isinstance(value, dict) else [1, "x", []]
