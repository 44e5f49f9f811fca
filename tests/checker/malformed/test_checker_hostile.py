"""Files that are made to hurt: refused in a sentence within seconds of processor time and 500 MB."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import combinations_with_replacement, islice
from pathlib import Path
from typing import Any

import pytest

import cpcal
from cpcal.files.folders import NAME

SECONDS, BYTES = 10, 500 << 20
ZERO, ONE = "0x0p+0", "0x1p+0"
Line = dict[str, Any]


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))


def checked(*paths: Path) -> subprocess.CompletedProcess[str]:
    """By a bare Python that is ended when it takes more than that."""
    folder = str(Path(cpcal.__file__).parent / "checker")
    command = [sys.executable, "-I", "-S", folder, *map(str, paths)]
    return subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limited)


def header(unknowns: int, constraints: int, *, lo: str = ZERO, hi: str = ONE, objective: int | None = None) -> Line:
    names = [f"x{i}" for i in range(unknowns)]
    head = {"format": "cpcal-certificate/4", "about": "", "unknowns": names, "objective": objective}
    return head | {"constraints": constraints, "lo": [lo] * unknowns, "hi": [hi] * unknowns}


def constraint(body: list[Any], *, root: bool = False, at_most: list[Any] | None = None) -> Line:
    return {"name": "c", "root": root, "body": body, "at_least": None, "at_most": [] if at_most is None else at_most}


CLAIMS: Line = {"cap": None, "infeasible": True, "epsilon": None, "enclosure": None, "point": None}


def weights(rows: list[Any] | None = None, **others: Any) -> Line:
    parts: Line = {"rows": [[0, 1]] if rows is None else rows, "products": [], "tangents": []}
    return parts | {"exponents": [0, 0, 0]} | others


def exclusion(side: str = "upper", box: int = 0) -> Line:
    return {"exclude": box, "cap": None, "rows": [[side, 0]], "weights": weights()}


def monomials(unknowns: int, degree: int, count: int) -> Iterator[list[int]]:
    return (list(m) for m in islice(combinations_with_replacement(range(unknowns), degree), count))


def a_root_of_4000_terms_squared() -> list[Line]:
    wide = [[m, ONE] for m in monomials(1000, 1, 1000)] + [[m, ONE] for m in monomials(100, 2, 3000)]
    return [header(1000, 1), constraint([[[], ONE]], root=True, at_most=wide), CLAIMS, exclusion()]


def monomials_of_degree_8() -> list[Line]:
    body = [[m, ONE] for m in monomials(30, 8, 80_000)]
    return [header(30, 1), constraint(body), CLAIMS, exclusion()]


def many_constraints_of_degree_8() -> list[Line]:
    bodies = [constraint([[m, ONE] for m in monomials(20, 8, 40)]) for _ in range(2000)]
    rows = [["upper", k] for k in range(2000)]
    return [
        header(20, 2000),
        *bodies,
        CLAIMS,
        exclusion() | {"rows": rows, "weights": weights([[k, 1] for k in range(2000)])},
    ]


def powers_of_long_numbers() -> list[Line]:
    long = "0x" + "f" * 64 + "." + "f" * 64 + "p+1100"
    body = [[m, long] for m in monomials(6, 8, 1000)]
    return [header(6, 1, lo="-" + long, hi=long), constraint(body), CLAIMS, exclusion()]


def numbers_far_apart() -> list[Line]:
    body = [[m, "0x1p+1100" if n % 2 else "0x1p-1100"] for n, m in enumerate(monomials(6, 8, 1000))]
    return [header(6, 1, lo="0x1p-1100", hi="0x1p+1100"), constraint(body), CLAIMS, exclusion()]


def splits_of_a_thousand_unknowns() -> Iterator[Line]:
    yield from (header(1000, 1), constraint([[[0], ONE]]), CLAIMS)
    for n in range(99_000):
        yield {"split": 2 * n, "unknown": n % 1000, "at": ZERO, "into": [2 * n + 1, 2 * n + 2]}


def a_million_steps() -> Iterator[Line]:
    yield from (header(1000, 1), constraint([[[0], ONE]]), CLAIMS)
    for _ in range(100_000):
        yield {"pass": 0, "cap": None, "rows": [], "bounds": []}


def bounds_by_the_thousand() -> list[Line]:
    entry = [0, "lo", ZERO, weights(tangents=[[0, "0x1p-1100", 1], [0, "0x1p+1100", 1]])]
    return [header(1000, 1), constraint([[[0], ONE]]), CLAIMS,
            *[{"pass": 0, "cap": None, "rows": [["upper", 0]], "bounds": [entry] * 9000}] * 5]  # fmt: skip


def products_by_the_thousand() -> list[Line]:
    pairs = [[i, j, 1, -1, 1] for i in range(1000) for j in range(100)]
    return [header(1000, 1), constraint([[[0], ONE]]), CLAIMS,
            *[exclusion() | {"weights": weights(products=pairs)}] * 5]  # fmt: skip


def sums_that_grow_from_step_to_step() -> Iterator[Line]:
    """Each term of a row of 20,000 was once charged a quarter unit, and each step's rows were kept."""
    body = [[m, ONE] for m in monomials(200, 2, 20_000)]
    yield from (header(200, 1, lo="-" + ONE), constraint(body), CLAIMS)
    for _ in range(3000):
        yield {"pass": 0, "cap": None, "rows": [["upper", 0]], "bounds": [[0, "lo", "-" + ONE, weights()]]}


CASES: list[Callable[[], Any]] = [
    sums_that_grow_from_step_to_step,
    a_root_of_4000_terms_squared,
    monomials_of_degree_8,
    many_constraints_of_degree_8,
    powers_of_long_numbers,
    numbers_far_apart,
    splits_of_a_thousand_unknowns,
    a_million_steps,
    bounds_by_the_thousand,
    products_by_the_thousand,
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_work_without_end(case: Callable[[], Any], tmp_path: Path) -> None:
    path = tmp_path / "hostile.cert.jsonl"
    with path.open("w") as out:
        out.writelines(json.dumps(line) + "\n" for line in case())
    done = checked(path)
    assert (done.returncode, done.stderr) == (1, ""), done.stderr[-300:]
    assert done.stdout.startswith("REFUSED: line ")


def test_rows_of_a_leg_by_the_thousand(uncertain_proof: Any, tmp_path: Path) -> None:
    """Each with another reference reading."""
    lines = uncertain_proof.copy()
    step, signs = lines[-1], ["".join("-0+"[n // 3**j % 3] for j in range(7)) for n in range(3**7)]
    step["rows"] = [["lower", k, text] for k in range(16) for text in signs]
    step["bounds"] = [[7, "lo", ZERO, weights([[n, 1] for n in range(len(step["rows"]))])]]
    path = tmp_path / "hostile.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    (tmp_path / NAME).write_bytes((uncertain_proof.folder / NAME).read_bytes())
    done = checked(path)
    assert (done.returncode, done.stderr) == (1, ""), done.stderr[-300:]


def test_endless_files(exact_proof: Any, tmp_path: Path) -> None:
    """Zeros without end are no regular file, a file of zeros is refused at its beginning, a pipe is not waited for."""
    zeros, pipe = tmp_path / "zeros.cert.jsonl", tmp_path / "pipe.cert.jsonl"
    with zeros.open("wb") as out:
        out.truncate(2 << 30)
    os.mkfifo(pipe)
    for path, status in ((Path("/dev/zero"), 2), (pipe, 2), (tmp_path / "missing", 2), (zeros, 1)):
        done = checked(path)
        assert done.returncode == status, done.stderr
    good = tmp_path / "leg1.cert.jsonl"
    good.write_text("".join(json.dumps(line) + "\n" for line in exact_proof.lines))
    for campaign, status in ((Path("/dev/zero"), 2), (pipe, 2), (zeros, 1), (good, 1)):
        done = checked(good, Path("--campaign"), campaign)
        assert done.returncode == status, done.stderr
    (tmp_path / NAME).symlink_to(zeros)
    (tmp_path / "result.json").symlink_to(zeros)
    assert checked(tmp_path).returncode == 1


CONTENTS = {
    "deep lists": b"[" * 200_000 + b"]" * 200_000,
    "deep objects": b'{"measurements":' * 100_000 + b"0" + b"}" * 100_000,
    "a float": b'{"measurements": 1.5}',
    "an infinite float": b'{"measurements": 1e999}',
    "a long integer": b'{"measurements": ' + b"9" * 5000 + b"}",
    "a key twice": b'{"format": 1, "format": 1}',
    "NaN": b'{"measurements": NaN}',
    "not UTF-8": b'{"\xff": 1}',
    "a byte order mark": b"\xef\xbb\xbf{}",
    "empty lists": b"[" + b"[]," * 5_000_000 + b"[]]",
    "short texts": b"[" + b'"ab",' * 3_000_000 + b'""]',
    "nothing": b"",
}


@pytest.mark.parametrize("name", CONTENTS)
def test_campaigns_that_are_none(name: str, exact_proof: Any, tmp_path: Path) -> None:
    content, lines = CONTENTS[name], exact_proof.copy()
    (tmp_path / NAME).write_bytes(content)
    lines[0]["campaign"] = hashlib.sha256(content).hexdigest()
    path = tmp_path / "leg1.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    done = checked(path)
    assert done.returncode == 1, done.stderr
    assert done.stdout.startswith(f"REFUSED: {NAME}")
    assert len(done.stdout) < 200
    assert done.stdout.isascii()
