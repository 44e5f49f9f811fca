"""Files damaged at random: as by a slip of the hand, a broken disk, a careless script or somebody hostile."""

import random
import re
from collections.abc import Callable

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]{2,}")
_HOSTILE_NUMBERS = [
    *(b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e999", b"-1e999", b"1e308", b"1e155", b"-1e200", b"5e-324"),
    *(b"0", b"-0.0", b"1", b"-1", b"2", b"9" * 400, b"9" * 5000, b"0x1p10", b"1_000", b"true", b"null", b'"1"', b""),
]
_HOSTILE_TEXTS = [
    *(b"\x00", b"\xff", b"\xef\xbb\xbf", b"\n", b"\r", b"\xe2\x80\xae", b"\\u202e", b"\\ud800", b"\x1b[2J", b"=cmd"),
    *(bytes([c]) for c in b"[]{}\"',.=#/"),
    *(b"..", b"[" * 5000, b'{"a":' * 2000, b"x" * 70000),
]

Mutation = Callable[[random.Random, bytes], bytes]


def _flip(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _cut(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.choice([1, 2, 10, 100]) :]


def _end(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data))]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(_HOSTILE_TEXTS) + data[at:]


def _number(rng: random.Random, data: bytes) -> bytes:
    """Another number, or something that is none, in place of a number."""
    return _replaced(rng, data, _NUMBER, lambda _: rng.choice(_HOSTILE_NUMBERS))


def _digit(rng: random.Random, data: bytes) -> bytes:
    """The number with one digit changed: what no reader can notice by itself."""

    def changed(old: bytes) -> bytes:
        at = rng.choice([k for k, c in enumerate(old) if chr(c).isdigit()])
        return old[:at] + str(rng.randrange(10)).encode() + old[at + 1 :]

    return _replaced(rng, data, _NUMBER, changed)


def _sign(rng: random.Random, data: bytes) -> bytes:
    return _replaced(rng, data, _NUMBER, lambda old: old[1:] if old.startswith(b"-") else b"-" + old)


def _other_number(rng: random.Random, data: bytes) -> bytes:
    """A number of the file in place of another one of it."""
    numbers = _NUMBER.findall(data) or [b"1"]
    return _replaced(rng, data, _NUMBER, lambda _: rng.choice(numbers))


def _word(rng: random.Random, data: bytes) -> bytes:
    """A word of the file, a misspelt one or a hostile text in place of a word."""
    words = _WORD.findall(data) or [b"x"]
    kinds: list[Callable[[bytes], bytes]] = [
        lambda old: rng.choice(words),
        lambda old: old[:-1],
        lambda old: old + old[-1:],
        lambda old: rng.choice(_HOSTILE_TEXTS),
    ]
    return _replaced(rng, data, _WORD, rng.choice(kinds))


def _lines(rng: random.Random, data: bytes) -> bytes:
    """A line taken out, doubled, or exchanged with another one."""
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _replaced(rng: random.Random, data: bytes, what: re.Pattern[bytes], by: Callable[[bytes], bytes]) -> bytes:
    places = [m.span() for m in what.finditer(data)]
    if not places:
        return _flip(rng, data)
    start, end = rng.choice(places)
    return data[:start] + by(data[start:end]) + data[end:]


MUTATIONS: dict[str, Mutation] = {
    "bit flipped": _flip, "piece cut out": _cut, "end cut off": _end, "text inserted": _insert,
    "number replaced": _number, "digit changed": _digit, "sign changed": _sign, "other number": _other_number,
    "word replaced": _word, "lines changed": _lines,
}  # fmt: skip


def mutated(rng: random.Random, data: bytes) -> tuple[str, bytes]:
    """The name of a mutation, or of two, and the bytes after it; never the bytes as they were."""
    while True:
        names = rng.choices(list(MUTATIONS), k=rng.choice([1, 1, 1, 2]))
        out = data
        for name in names:
            out = MUTATIONS[name](rng, out) if out else out
        if out != data:
            return " + ".join(names), out
