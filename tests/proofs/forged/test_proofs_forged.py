"""Forgeries by hand: each is refused, at the line where the lie is told."""

from __future__ import annotations

import json
import math
import shutil
import tracemalloc
from collections.abc import Callable
from fractions import Fraction as F
from pathlib import Path
from typing import Any

import pytest

from cpcal.proof.checker import check
from cpcal.proof.refusal import Refused

# in the true certificate: 1 header, 2 claims, 3 split, 4 exclude, 5 pass, 6 split, 7 witness
HEADER, CLAIMS, SPLIT, EXCLUDE, PASS, HALVE, WITNESS = range(7)
Lines = list[dict[str, Any]]
Forgery = Callable[[Lines], int]  # changes the lines; the index of the line that must be refused
FORGERIES: dict[str, Forgery] = {}


def forgery(change: Forgery) -> Forgery:
    FORGERIES[change.__name__] = change
    return change


def place(name: str, index: int, *path: Any, value: Any, refused: int | None = None) -> None:
    """The forgery that puts `value` (or what it makes of the old one) at a path of a line."""

    def change(lines: Lines) -> int:
        target: Any = lines[index]
        for key in path[:-1]:
            target = target[key]
        target[path[-1]] = value(target[path[-1]]) if callable(value) else value
        return index if refused is None else refused

    FORGERIES[name] = change


def moved(text: str, towards: float, ulps: int = 1) -> str:
    value = float.fromhex(text)
    for _ in range(ulps):
        value = math.nextafter(value, towards)
    return value.hex()


def negated(text: str) -> str:
    return (-float.fromhex(text)).hex()


UP, DOWN = math.inf, -math.inf
WEIGHTS = ("bounds", 0, 3)

# the header
place("another format", HEADER, "format", value="cpcal-certificate/2")
place("format is a list", HEADER, "format", value=["cpcal-certificate/1"])
place("another digest", HEADER, "campaign", value=lambda text: text[:-1] + ("0" if text[-1] != "0" else "1"))
place("digest in capitals", HEADER, "campaign", value=lambda text: text.upper())
place("digest is no text", HEADER, "campaign", value=0)
place("one measurement more", HEADER, "measurements", value=lambda n: n + 1)
place("one measurement less", HEADER, "measurements", value=lambda n: n - 1)
place("measurements as a float", HEADER, "measurements", value=float)
place("measurements as a list", HEADER, "measurements", value=lambda n: [n])
place("another leg", HEADER, "leg", value=2, refused=EXCLUDE)
place("leg is true", HEADER, "leg", value=True)
place("leg is negative", HEADER, "leg", value=-1)
place("empty box", HEADER, "lo", 2, value="0x1p+20")
place("six unknowns", HEADER, "lo", value=lambda v: v[:6])
place("wider box", HEADER, "hi", value=lambda v: [(float.fromhex(w) + 50).hex() for w in v], refused=EXCLUDE)
place("negative cap", HEADER, "cap", value="-0x1p-30")
place("number in decimal", HEADER, "cap", value="1.5")
place("number as a float", HEADER, "cap", value=1.5)
place("number as an integer", HEADER, "cap", value=1)
place("number is null", HEADER, "cap", value=None)
place("number is NaN", HEADER, "cap", value="nan")
place("number is infinite", HEADER, "cap", value="inf")
place("huge exponent", HEADER, "cap", value="0x1p9999")
place("five digits of exponent", HEADER, "cap", value="0x1p99999")
place("number in capitals", HEADER, "cap", value="0X1P+0")
place("number with spaces", HEADER, "cap", value=" 0x1p+0")
place("number with a newline", HEADER, "cap", value="0x1p+0\n")
place("number with fullwidth digits", HEADER, "cap", value="0x1p+\uff11")
place("number too long", HEADER, "cap", value="0x1." + "0" * 60 + "p+0")
place("number that float64 has not", HEADER, "cap", value="0x1.8p-1074")
# the claims
place("eps_lo one ulp up", CLAIMS, "eps_lo", value=lambda text: moved(text, UP), refused=WITNESS)
place("eps_lo negative", CLAIMS, "eps_lo", value="-0x1p-1074")
place("eps_lo above the cap", CLAIMS, "eps_lo", value="0x1p+9")
place("eps_lo vanishes in float64", CLAIMS, "eps_lo", value="0x1p-9999")
place("eps_hi below eps_lo", CLAIMS, "eps_hi", value="0x1p-60")
place("eps_hi withdrawn, witness left", CLAIMS, "eps_hi", value=None, refused=WITNESS)
place("cap above that of the problem", CLAIMS, "cap", value=lambda text: moved(text, UP))
place("enclosure lo one ulp up", CLAIMS, "enclosure", "lo", 0, value=lambda t: moved(t, UP), refused=WITNESS)
place("enclosure hi one ulp down", CLAIMS, "enclosure", "hi", 6, value=lambda t: moved(t, DOWN), refused=WITNESS)
place("enclosure beside the box", CLAIMS, "enclosure", "lo", 3, value="0x1p+99", refused=WITNESS)
place("enclosure of six", CLAIMS, "enclosure", "hi", value=lambda v: v[:6])
place("enclosure without hi", CLAIMS, "enclosure", value={"lo": []})
# the split on eps
place("cut below the box", SPLIT, "at", value="-0x1p+0")
place("cut above the box", SPLIT, "at", value="0x1p+9")
place("split of a box never made", SPLIT, "split", value=7)
place("box name is true", SPLIT, "split", value=False)
place("box name is a float", SPLIT, "split", value=0.0)
place("box name is a text", SPLIT, "split", value="0")
place("box name is a list", SPLIT, "split", value=[0])
place("one child", SPLIT, "into", value=[1])
place("three children", SPLIT, "into", value=[1, 2, 3])
place("twins", SPLIT, "into", value=[1, 1])
place("children swapped", SPLIT, "into", value=[2, 1])
place("child named as its parent", SPLIT, "into", value=[0, 1])
place("children named by floats", SPLIT, "into", value=[1.0, 2.0])
place("children named by true", SPLIT, "into", value=[True, 2])
place("split along unknown 8", SPLIT, "unknown", value=8)
place("split along unknown -1", SPLIT, "unknown", value=-1)
place("split along true", SPLIT, "unknown", value=True)
place("split along another unknown", SPLIT, "unknown", value=0)
# the exclusion
place("wrong part excluded", EXCLUDE, "exclude", value=2)
place("excluded cap below that of the claims", EXCLUDE, "cap", value=lambda text: moved(text, DOWN))
place("excluded without weights", EXCLUDE, "weights", value={"rows": [], "products": [], "tangents": []})
place("weights without tangents", EXCLUDE, "weights", value={"rows": [], "products": []})
place(
    "excluded, all rows heavier", EXCLUDE, "weights", "rows", value=lambda rows: [[s, k, "0x1p-60"] for s, k, _ in rows]
)
# the pass
place("weight of a row negative", PASS, *WEIGHTS, "rows", 0, 2, value=negated)
place("weight of a row NaN", PASS, *WEIGHTS, "rows", 0, 2, value="nan")
place("weight of a row huge", PASS, *WEIGHTS, "rows", 0, 2, value="0x1p+60")
place("row dropped", PASS, *WEIGHTS, "rows", value=lambda rows: rows[1:])
place("upper is lower", PASS, *WEIGHTS, "rows", 0, 0, value=lambda s: {"upper": "lower"}.get(s, "upper"))
place("row of another measurement", PASS, *WEIGHTS, "rows", 0, 1, value=lambda k: (k + 1) % 12)
place("row after the last", PASS, *WEIGHTS, "rows", 0, 1, value=12)
place("row -1", PASS, *WEIGHTS, "rows", 0, 1, value=-1)
place("row true", PASS, *WEIGHTS, "rows", 0, 1, value=True)
place("row of no side", PASS, *WEIGHTS, "rows", 0, 0, value="middle")
place("side is a list", PASS, *WEIGHTS, "rows", 0, 0, value=["upper"])
place("row of four", PASS, *WEIGHTS, "rows", 0, value=lambda row: [*row, "0x1p+0"])
place("rows are an object", PASS, *WEIGHTS, "rows", value={})
place("product with p = 2", PASS, *WEIGHTS, "products", value=[[0, 1, 2, 1, "0x1p-9"]])
place("product with q = 0", PASS, *WEIGHTS, "products", value=[[0, 1, 1, 0, "0x1p-9"]])
place("product with p = 1.0", PASS, *WEIGHTS, "products", value=[[0, 1, 1.0, 1, "0x1p-9"]])
place("product with p = true", PASS, *WEIGHTS, "products", value=[[0, 1, True, 1, "0x1p-9"]])
place("product of unknown 8", PASS, *WEIGHTS, "products", value=[[0, 8, 1, 1, "0x1p-9"]])
place("product with a negative weight", PASS, *WEIGHTS, "products", value=[[0, 1, 1, 1, "-0x1p+9"]])
place("tangent of unknown 8", PASS, *WEIGHTS, "tangents", value=[[8, "0x0p+0", "0x1p-9"]])
place("tangent with a negative weight", PASS, *WEIGHTS, "tangents", value=[[7, "0x0p+0", "-0x1p+9"]])
place("tangent at infinity", PASS, *WEIGHTS, "tangents", value=[[7, "inf", "0x1p-9"]])
place("bound of unknown 8", PASS, "bounds", 0, 0, value=8)
place("bound on no side", PASS, "bounds", 0, 1, value="both")
place("bound on the other side", PASS, "bounds", 0, 1, value=lambda s: {"lo": "hi"}.get(s, "lo"))
place("bound of another unknown", PASS, "bounds", 0, 0, value=lambda i: (i + 1) % 8)
place("bound of three", PASS, "bounds", 0, value=lambda entry: entry[:3])
place("pass on a closed box", PASS, "pass", value=1)
place("pass on a split box", PASS, "pass", value=0)
place("pass with a cap below that of the claims", PASS, "cap", value=lambda text: moved(text, DOWN))
place("pass without bounds", PASS, "bounds", value=[], refused=WITNESS)
# the second split and the witness
place("names used before", HALVE, "into", value=[1, 2])
place("names left out", HALVE, "into", value=[4, 5])
place("cut outside the box", HALVE, "at", value="0x1p+20")
place("point outside the box", WITNESS, "point", 0, value="0x1p+20")
place("point elsewhere in the box", WITNESS, "point", 0, value=lambda t: (float.fromhex(t) + 9e-4).hex())
place("point of six", WITNESS, "point", value=lambda v: v[:6])
place("point with NaN", WITNESS, "point", 0, value="nan")


@forgery
def excluded_part_too_large(lines: Lines) -> int:
    lines[SPLIT]["at"] = lines[HEADER]["cap"]
    return EXCLUDE


@forgery
def unknown_key_in_the_header(lines: Lines) -> int:
    lines[HEADER]["note"] = "trust me"
    return HEADER


@forgery
def unknown_key_in_the_claims(lines: Lines) -> int:
    lines[CLAIMS]["feasible"] = True
    return CLAIMS


@forgery
def unknown_key_in_a_step(lines: Lines) -> int:
    lines[PASS]["note"] = ""
    return PASS


@forgery
def readings_given_with_the_witness(lines: Lines) -> int:
    lines[WITNESS]["readings"] = []
    return WITNESS


@forgery
def pass_and_exclude_in_one(lines: Lines) -> int:
    lines[PASS]["exclude"] = 2
    return PASS


@forgery
def no_step_at_all(lines: Lines) -> int:
    lines[PASS] = {"because": "I say so"}
    return PASS


@forgery
def claims_twice(lines: Lines) -> int:
    lines.insert(2, lines[CLAIMS])
    return 2


@forgery
def header_twice(lines: Lines) -> int:
    lines.insert(1, lines[HEADER])
    return 1


@forgery
def claims_first(lines: Lines) -> int:
    lines[:2] = lines[1], lines[0]
    return 0


@forgery
def split_dropped(lines: Lines) -> int:
    del lines[SPLIT]
    return SPLIT


@forgery
def split_twice(lines: Lines) -> int:
    lines.insert(SPLIT, lines[SPLIT])
    return SPLIT + 1


@forgery
def exclusion_dropped(lines: Lines) -> int:
    del lines[EXCLUDE]
    return len(lines) - 1


@forgery
def exclusion_twice(lines: Lines) -> int:
    lines.insert(EXCLUDE, lines[EXCLUDE])
    return EXCLUDE + 1


@forgery
def pass_dropped(lines: Lines) -> int:
    del lines[PASS]
    return len(lines) - 1


@forgery
def witness_dropped(lines: Lines) -> int:
    del lines[WITNESS]
    return len(lines) - 1


@forgery
def witness_twice(lines: Lines) -> int:
    lines.append(lines[WITNESS])
    return len(lines) - 1


@forgery
def step_after_the_witness(lines: Lines) -> int:
    lines.append({"split": 3, "unknown": 0, "at": lines[WITNESS]["point"][0], "into": [5, 6]})
    return len(lines) - 1


@forgery
def header_only(lines: Lines) -> int:
    del lines[1:]
    return 1


@forgery
def no_steps(lines: Lines) -> int:
    del lines[2:WITNESS]
    return len(lines) - 1


@pytest.mark.parametrize("name", FORGERIES)
def test_forgeries_are_refused_at_their_line(name: str, verdict: Any, split_proof: Any) -> None:
    lines = split_proof.copy()
    expected = FORGERIES[name](lines) + 1
    assert json.dumps(lines) != json.dumps(split_proof.lines)
    with pytest.raises(Refused) as caught:
        verdict(lines, split_proof.folder)
    assert caught.value.line == expected, str(caught.value)
    assert str(caught.value).startswith(f"line {expected}: ")
    assert str(caught.value).isascii()
    assert str(caught.value).isprintable()


def test_bounds_one_ulp_beyond_the_proof(verdict: Any, exact_proof: Any, uncertain_proof: Any) -> None:
    """The bound that is written is the last float64 that is proved; the next one is refused."""
    for proof in (exact_proof, uncertain_proof):
        count = len(proof.lines[2]["bounds"])
        assert count >= 2
        for n in range(count):
            lines = proof.copy()
            entry = lines[2]["bounds"][n]
            entry[2] = moved(entry[2], UP if entry[1] == "lo" else DOWN)
            with pytest.raises(Refused, match="prove less") as caught:
                verdict(lines, proof.folder)
            assert caught.value.line == 3


def test_eps_hi_one_ulp_below_the_least_that_the_witness_shows(verdict: Any, exact_proof: Any) -> None:
    """For exact readings that is the largest | ||v|| - (L + l) |; here it is found in decimals and by bisection."""
    exact, x = exact_proof.exact, [F(v) for v in exact_proof.point]

    def shown(eps: float) -> bool:
        for k in range(len(exact)):
            m = exact.measurement(k)
            w, *q = m.quaternion
            scale = w * w + sum((c * c for c in q), F(0))
            b = x[3:6]
            t = [2 * (q[1] * b[2] - q[2] * b[1]), 2 * (q[2] * b[0] - q[0] * b[2]), 2 * (q[0] * b[1] - q[1] * b[0])]
            u = [q[1] * t[2] - q[2] * t[1], q[2] * t[0] - q[0] * t[2], q[0] * t[1] - q[1] * t[0]]
            v = [m.position[i] + b[i] + (w * t[i] + u[i]) / scale - x[i] for i in range(3)]
            length = sum((c * c for c in v), F(0))
            base = m.length + x[6]
            if not (base - F(eps)) ** 2 <= length <= (base + F(eps)) ** 2:
                return False
        return True

    low, high = 0.9 * exact_proof.eps_hi, 1.1 * exact_proof.eps_hi
    while math.nextafter(low, UP) < high:
        middle = (low + high) / 2
        low, high = (low, middle) if shown(middle) else (middle, high)
    assert exact_proof.eps_lo <= low
    lines = exact_proof.copy()
    lines[1]["eps_hi"] = high.hex()
    assert verdict(lines, exact_proof.folder).eps_hi == F(high)
    lines[1]["eps_hi"] = low.hex()
    with pytest.raises(Refused, match="enough") as caught:
        verdict(lines, exact_proof.folder)
    assert caught.value.line == 4


def test_uncertain_witness_with_less_eps(verdict: Any, uncertain_proof: Any) -> None:
    lines = uncertain_proof.copy()
    lines[1].update(eps_hi=(0.99 * uncertain_proof.eps_hi).hex(), eps_lo="0x0p+0")
    with pytest.raises(Refused, match="enough") as caught:
        verdict(lines, uncertain_proof.folder)
    assert caught.value.line == 4


def test_a_leg_shorter_than_eps(verdict: Any, exact_proof: Any) -> None:
    lines = exact_proof.copy()
    lines[1]["eps_hi"] = "0x1p+20"
    with pytest.raises(Refused, match="not longer than eps_hi"):
        verdict(lines, exact_proof.folder)


# the campaign ---------------------------------------------------------------------------------------------------


@pytest.fixture
def moved_campaign(tmp_path: Path, exact_proof: Any) -> Path:
    folder = tmp_path / "other"
    shutil.copytree(exact_proof.folder, folder)
    return folder


@pytest.mark.parametrize("name", ["campaign.toml", "measurements.csv"])
def test_a_campaign_changed_after_the_fact(name: str, verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    file = moved_campaign / name
    content = file.read_bytes()
    file.write_bytes(content + b"\n")
    with pytest.raises(Refused, match="SHA-256") as caught:
        verdict(exact_proof.lines, moved_campaign)
    assert caught.value.line == 1
    digit = max(content.rfind(d) for d in b"123456789")
    file.write_bytes(content[:digit] + b"0" + content[digit + 1 :])
    with pytest.raises(Refused, match="SHA-256"):
        verdict(exact_proof.lines, moved_campaign)


def test_another_campaign_with_its_own_digest(verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    """The digest is put right again; the proof is not."""
    from cpcal.proof.campaign import ExactCampaign

    file = moved_campaign / "measurements.csv"
    rows = file.read_text().splitlines()
    names, cells = rows[0].split(","), rows[1].split(",")
    at = names.index("L1")
    cells[at] = repr(float(cells[at]) + 0.5)
    file.write_text("\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n")
    lines = exact_proof.copy()
    lines[0]["campaign"] = ExactCampaign(moved_campaign, 1).sha256
    with pytest.raises(Refused):
        verdict(lines, moved_campaign)


def test_a_rotation_that_is_none(verdict: Any, exact_proof: Any, moved_campaign: Path) -> None:
    from cpcal.proof.campaign import ExactCampaign

    file = moved_campaign / "measurements.csv"
    rows = [row.split(",") for row in file.read_text().splitlines()]
    for row in rows[1:]:
        for name in ("qw", "qx", "qy", "qz"):
            row[rows[0].index(name)] = "0"
    file.write_text("\n".join(",".join(row) for row in rows) + "\n")
    lines = exact_proof.copy()
    lines[0]["campaign"] = ExactCampaign(moved_campaign, 1).sha256
    with pytest.raises(Refused, match="no rotation") as caught:
        verdict(lines, moved_campaign)
    assert caught.value.line == 0


def test_no_campaign(verdict: Any, exact_proof: Any, tmp_path: Path) -> None:
    with pytest.raises(Refused, match="cannot be read"):
        verdict(exact_proof.lines, tmp_path / "nowhere")


# bytes ------------------------------------------------------------------------------------------------------------


def refused(tmp_path: Path, content: bytes, folder: Path) -> Refused:
    path = tmp_path / "certificate.jsonl"
    path.write_bytes(content)
    with pytest.raises(Refused) as caught:
        check(path, folder)
    return caught.value


def encoded(lines: Lines) -> list[bytes]:
    return [json.dumps(line).encode() + b"\n" for line in lines]


def test_every_truncation_is_refused(tmp_path: Path, exact_proof: Any) -> None:
    content = b"".join(encoded(exact_proof.lines))
    sizes = [*range(40), *range(40, len(content) - 2, 97), len(content) - 2]
    for size in sizes:
        caught = refused(tmp_path, content[:size], exact_proof.folder)
        whole = content[:size].count(b"\n")
        assert caught.line in (whole, whole + 1, max(2, whole))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", 1),
        (b"\n", 1),
        (b"{}\n", 1),
        (b"[]\n", 1),
        (b"null\n", 1),
        (b"\xff\xfe{\n", 1),
        (b"\xef\xbb\xbf{}\n", 1),
        (b"\x00" * 100, 1),
        (b'{"format": NaN}\n', 1),
        (b'{"format": Infinity}\n', 1),
        (b'{"leg": ' + b"9" * 5000 + b"}\n", 1),
        (b'{"\\ud800": "\\ud800"}\n', 1),
        (b"[" * 100_000 + b"]" * 100_000, 1),
        (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, 1),
        (b"{" + b" " * (5 << 20) + b"}\n", 1),
    ],
)
def test_files_that_are_none(tmp_path: Path, exact_proof: Any, content: bytes, line: int) -> None:
    assert refused(tmp_path, content, exact_proof.folder).line == line


def test_not_utf8_in_the_middle(tmp_path: Path, exact_proof: Any) -> None:
    lines = encoded(exact_proof.lines)
    lines[2] = lines[2].replace(b"lo", b"l\xff", 1)
    assert refused(tmp_path, b"".join(lines), exact_proof.folder).line == 3


def test_a_key_twice(tmp_path: Path, exact_proof: Any) -> None:
    lines = encoded(exact_proof.lines)
    lines[1] = lines[1].replace(b'{"cap"', b'{"eps_lo": "0x0p+0", "cap"', 1)
    caught = refused(tmp_path, b"".join(lines), exact_proof.folder)
    assert caught.line == 2
    assert "twice" in caught.reason


def test_an_empty_line_between(tmp_path: Path, exact_proof: Any) -> None:
    lines = encoded(exact_proof.lines)
    lines.insert(2, b"\n")
    assert refused(tmp_path, b"".join(lines), exact_proof.folder).line == 3


@pytest.mark.parametrize("text", ["\ud800", "\x1b[2J", "\u202e", "\n", "x" * 100_000])
def test_hostile_texts_do_not_reach_the_terminal(text: str, verdict: Any, exact_proof: Any) -> None:
    for index, path in ((2, ("pass",)), (2, ("cap",)), (2, ("bounds", 0, 0)), (2, ("bounds", 0, 3, "rows", 0, 0))):
        lines = exact_proof.copy()
        target: Any = lines[index]
        for key in path[:-1]:
            target = target[key]
        target[path[-1]] = text
        with pytest.raises(Refused) as caught:
            verdict(lines, exact_proof.folder)
        assert str(caught.value).isascii()
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 300


@pytest.mark.parametrize("depth", [100, 900, 940, 960, 980, 990, 1000])
def test_deep_values_where_numbers_are_needed(depth: int, verdict: Any, tmp_path: Path, exact_proof: Any) -> None:
    deep = b"[" * depth + b"]" * depth
    for key in (b'"eps_lo"', b'"cap"', b'"eps_hi"'):
        first, _ = encoded(exact_proof.lines)[:2]
        claims = b'{"cap": 1, "eps_lo": 1, "enclosure": null, "eps_hi": 1}\n'.replace(key + b": 1", key + b": " + deep)
        assert refused(tmp_path, first + claims, exact_proof.folder).line == 2


def test_a_huge_line_takes_little_memory(tmp_path: Path, exact_proof: Any) -> None:
    path = tmp_path / "huge.jsonl"
    with path.open("wb") as out:
        for _ in range(64):
            out.write(b"[" + b"0," * (1 << 19))
    tracemalloc.start()
    try:
        with pytest.raises(Refused, match="4 MiB") as caught:
            check(path, exact_proof.folder)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert caught.value.line == 1
    assert peak < 32 << 20


def test_a_directory_and_a_missing_file(tmp_path: Path, exact_proof: Any) -> None:
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(Refused) as caught:
            check(path, exact_proof.folder)
        assert caught.value.line == 0


def test_there_are_enough() -> None:
    assert len(FORGERIES) >= 100
