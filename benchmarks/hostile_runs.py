"""Runs that are made to hurt: each spends what its check may cost in the way that is dearest for the checker.

    python -m benchmarks.hostile_runs [NAME ...] [--work N]

prints the seconds of processor time and the MB of each: do little else meanwhile. The checker says within 10 s and
500 MB what it thinks of any of them; tests/checker/malformed sees to that with a twentieth of the work.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from hashlib import sha256
from itertools import chain, combinations_with_replacement, islice, repeat
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

import cpcal
from benchmarks import asked, run_by_hand

SECONDS, MEGABYTES = 10, 500
ZERO, ONE, FAR = "0x0p+0", "0x1p+0", "-0x1p+1000"
STEPS = 60  # with the same long line, of which the work allows fewer
LONG = "0x" + "f" * 64 + "." + "f" * 64
Line = dict[str, Any]
CASES: dict[str, Callable[[Path], None]] = {}


class Measured(NamedTuple):
    seconds: float
    megabytes: float
    status: int
    said: str


def measured(*arguments: object, seconds: int = 3 * SECONDS, megabytes: int = 3 * MEGABYTES) -> Measured:
    """What a bare Python says of a run, and what that takes; it is ended where it takes more than that."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))

    command = [sys.executable, "-I", "-S", str(Path(cpcal.__file__).parent / "checker"), *map(str, arguments)]
    pipe, merged = subprocess.PIPE, subprocess.STDOUT
    with subprocess.Popen(command, stdout=pipe, stderr=merged, text=True, preexec_fn=limited) as it:
        said = it.stdout.read() if it.stdout else ""
        _, status, used = os.wait4(it.pid, 0)
        it.returncode = os.waitstatus_to_exitcode(status)
    return Measured(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, it.returncode, said)


# certificates that state their constraints --------------------------------------------------------------------------


def header(unknowns: int, constraints: int, *, lo: str = ZERO, hi: str = ONE, objective: int | None = None) -> Line:
    names = [f"x{i}" for i in range(unknowns)]
    head = {"format": "cpcal-certificate/6", "about": "", "unknowns": names, "objective": objective}
    return head | {"constraints": constraints, "lo": [lo] * unknowns, "hi": [hi] * unknowns}


def constraint(body: list[Any], *, root: bool = False, at_most: list[Any] | None = None) -> Line:
    return {"name": "c", "root": root, "body": body, "at_least": None, "at_most": [] if at_most is None else at_most}


CLAIMS: Line = {"cap": None, "infeasible": True, "epsilon": None, "enclosure": None, "point": None}


def weights(rows: list[Any] | None = None, **others: Any) -> Line:
    parts: Line = {"rows": [[0, 1]] if rows is None else rows, "products": [], "tangents": []}
    return parts | {"exponents": [0, 0, 0]} | others


def exclusion(**others: Any) -> Line:
    return {"exclude": 0, "cap": None, "rows": [["upper", 0]], "weights": weights()} | others


def bounds(number: int, of: Line, rows: list[Any] | None = None, *, cap: str | None = None) -> Line:
    """A pass that proves nothing new, so that others may follow."""
    rows = [["upper", 0]] if rows is None else rows
    return {"pass": 0, "cap": cap, "rows": rows, "bounds": [[0, "lo", FAR, of]] * number}


def monomials(unknowns: int, degree: int, count: int) -> Iterator[list[int]]:
    return (list(m) for m in islice(combinations_with_replacement(range(unknowns), degree), count))


def written(lines: Iterable[Line], path: Path) -> None:
    last, text = None, ""
    with path.open("w") as out:
        for line in lines:
            if line is not last:
                last, text = line, json.dumps(line, separators=(",", ":")) + "\n"
            out.write(text)


SMALL = (header(1, 1, lo="-" + ONE), constraint([[[0], ONE]]), CLAIMS)
WIDE = (header(1000, 1), constraint([[[0], ONE]]), CLAIMS)  # of a thousand unknowns


def with_body(unknowns: int, body: list[Any], *more: Line, **options: Any) -> Iterator[Line]:
    """A certificate of one constraint, and its steps: an exclusion, if none are given."""
    yield from (header(unknowns, 1, **options), constraint(body), CLAIMS, *(more or (exclusion(),)))


def splits(start: tuple[Line, ...], unknowns: int) -> Iterator[Line]:
    yield from start
    for n in range(19_900):
        yield {"split": 2 * n, "unknown": n % unknowns, "at": ZERO, "into": [2 * n + 1, 2 * n + 2]}


def squares_of_a_thousand_unknowns() -> Iterator[Line]:
    """Each monomial takes 6,000 bits."""
    yield header(1000, 40)
    for _ in range(40):
        yield constraint([[[], ONE]], root=True, at_most=[[[999 - i], ONE] for i in range(440)])
    yield CLAIMS
    for n in range(30):
        some = [["upper", k % 40] for k in range(n, n + 4)]
        yield bounds(1, weights([[k, 1] for k in range(4)]), some)


def many_constraints_of_degree_8() -> list[Line]:
    bodies = [constraint([[m, ONE] for m in monomials(20, 8, 40)]) for _ in range(2000)]
    rows, all_of_them = [["upper", k] for k in range(2000)], weights([[k, 1] for k in range(2000)])
    return [header(20, 2000), *bodies, CLAIMS, exclusion(rows=rows, weights=all_of_them)]


def a_root_of_4000_terms_squared() -> list[Line]:
    wide = [[m, ONE] for m in monomials(1000, 1, 1000)] + [[m, ONE] for m in monomials(100, 2, 3000)]
    return [header(1000, 1), constraint([[[], ONE]], root=True, at_most=wide), CLAIMS, exclusion()]


def a_point_of_many_constraints() -> Iterator[Line]:
    yield header(2, 100_000, lo="-" + ONE)
    yield from repeat(constraint([[[0], ONE]]), 100_000)
    point = {"at": [ZERO, ZERO], "holds": "all", "readings": None, "factor": None, "fails": []}
    yield CLAIMS | {"infeasible": False, "point": point}


CERTIFICATES: dict[str, Callable[[], Iterable[Line]]] = {
    "a_root_of_4000_terms_squared": a_root_of_4000_terms_squared,
    "squares_of_a_thousand_unknowns": squares_of_a_thousand_unknowns,
    "many_constraints_of_degree_8": many_constraints_of_degree_8,
    "a_point_of_many_constraints": a_point_of_many_constraints,
    "monomials_of_degree_8": lambda: with_body(30, [[m, ONE] for m in monomials(30, 8, 80_000)]),
    "powers_of_long_numbers": lambda: with_body(
        6, [[m, LONG + "p+1100"] for m in monomials(6, 8, 1000)], lo=f"-{LONG}p+1100", hi=LONG + "p+1100"),
    "products_of_long_numbers": lambda: with_body(
        8, [[m, LONG + "p+0"] for m in monomials(8, 4, 300)], *repeat(bounds(1, weights()), 3000),
        lo=f"-{LONG}p-500", hi=LONG + "p+0"),
    "numbers_far_apart": lambda: with_body(
        6, [[m, f"0x1p{'+' if n % 2 else '-'}1100"] for n, m in enumerate(monomials(6, 8, 1000))],
        lo="0x1p-1100", hi="0x1p+1100"),
    "splits_of_a_thousand_unknowns": lambda: splits(WIDE, 1000),
    "splits_of_one_unknown": lambda: splits(SMALL, 1),
    "a_hundred_thousand_steps": lambda: chain(WIDE, repeat(bounds(0, weights()), 100_000)),
    "bounds_by_the_thousand": lambda: chain(SMALL, repeat(bounds(30_000, weights()), STEPS)),
    "bounds_of_long_numbers": lambda: with_body(
        2, [[[0], ONE]], *repeat(bounds(9_000, weights(tangents=[[1, LONG + "p-800", 1]])), STEPS),
        lo=f"-{LONG}p-500", hi=LONG + "p-900"),
    "rows_that_no_bound_needs": lambda: chain(
        SMALL, repeat(bounds(0, weights(), [["upper", 0]] * 300_000), STEPS)),
    "products_by_the_thousand": lambda: chain(WIDE, repeat(bounds(1, weights(
        products=[[i, j, 1, -1, 1] for i in range(1000) for j in range(100)])), STEPS)),
    "tangents_by_the_thousand": lambda: chain(
        WIDE, repeat(bounds(1, weights(tangents=[[999, ONE, 1]] * 200_000)), STEPS)),
    # each term of a row of 20,000 was once charged a quarter unit, and each step's rows were kept
    "sums_that_grow_from_step_to_step": lambda: with_body(
        200, [[m, ONE] for m in monomials(200, 2, 20_000)], *repeat(bounds(1, weights()), 3000), lo="-" + ONE),
}  # fmt: skip


def alone(name: str) -> Callable[[Path], None]:
    """A case that is one certificate."""
    return lambda folder: written(CERTIFICATES[name](), folder / "hostile.cert.jsonl")


CASES |= {name: alone(name) for name in CERTIFICATES}


# runs ---------------------------------------------------------------------------------------------------------------


def campaign(folder: Path, measurements: int) -> None:
    """Of one leg, with reading sets."""
    nothing = dict.fromkeys(("files", "robot", "uncertainty", "model", "provenance"))
    whole = {"format": "cpcal-campaign-exact/1"} | nothing
    rows = (
        ["p", str(k), f"{k % 97}.{k + 12345678901}", "22.12345678901234", "402.3456789012345", "0.9876543210987654",
         "0.01234567890123456", f"0.0{k + 10000000001}", "0.0345678901234567", f"41{k % 9}.1234567890123",
         "0.0123456789", "0.0123456788", "0.0123456787", "0.00012345678", "0.00012345679", "0.0001234567", "0.012345"]
        for k in range(measurements)
    )  # fmt: skip
    (folder / "campaign.json").write_text(json.dumps(whole | {"measurements": list(rows)}, separators=(",", ":")))


def _leg(folder: Path, measurements: int, model: str, extra: int, steps: int) -> None:
    campaign(folder, measurements)
    digest = sha256((folder / "campaign.json").read_bytes()).hexdigest()
    n = 7 + extra
    lo, hi = ["-" + LONG + "p-250"] * n + [ZERO], [LONG + "p-250"] * n + ["0x1p+10"]
    head = {"format": "cpcal-certificate/6", "campaign": digest, "leg": 1, "model": model, "measurements": measurements}
    claims = CLAIMS | {"cap": "0x1p+10", "infeasible": False}
    rows = [[("upper", "lower")[k % 2], k % measurements, "0+-0-+0"] for k in range(40)]
    lines = (bounds(1, weights([[k, n + 1] for k in range(40)]), rows, cap="0x1p+10") for n in range(steps))
    written(iter([head | {"only": None, "lo": lo, "hi": hi}, claims, *lines]), folder / "leg1.cert.jsonl")


def _result(folder: Path, measurements: int, **changes: Any) -> None:
    """A campaign, and a result.json of no legs, of which nothing can be accepted."""
    campaign(folder, measurements)
    whole = {"format": "cpcal-result/14", "legs": [], "information": {}} | changes
    (folder / "result.json").write_text(json.dumps(whole, separators=(",", ":")))


def forms_of_long_numbers(folder: Path) -> None:
    """An accuracy's certificate: what a form can be at most is a power of products of ends."""
    _leg(folder, 4, "plain", 0, 1)
    lines = (folder / "leg1.cert.jsonl").read_text().splitlines()
    head = json.loads(lines[0])
    ends = [LONG + f"p-{k}00" for k in range(8)]
    head |= {"lo": ["-" + end for end in ends[:7]] + [ZERO], "hi": ends, "forms": [
        [[m, LONG + "p-400"] for m in monomials(7, 8, 3000)] for _ in range(4)
    ]}  # fmt: skip
    (folder / "leg1.cert.jsonl").write_text("\n".join([json.dumps(head), *lines[1:]]))


def a_study_of_many_points(folder: Path) -> None:
    """That no certificate speaks of."""
    camera: Line = {"size": [640, 480], "focal": [600.0, 600.5], "center": [320.0, 240.0], "model": "brown"}
    image = ["i", 10.1, 20.2, 30.3, 0.9, 0.1, 0.2, 0.3, *[0] * 6]
    point = [320.0, 240.0, 320.0, 240.0, 1.5, 2.5, 0.25, 0.5]
    camera |= {"distortion": [1e-3, 0, 0, 0, 0]}
    study = {"format": "cpcal-study/1", "setup": "eye-in-hand", "camera": camera, "images": [image]}
    points = [[0, str(k), *point] for k in range(19_900)]
    (folder / "study.json").write_text(json.dumps(study | {"points": points}, separators=(",", ":")))
    frames = {"camera_position": [0, 0, 0], "camera_quaternion": [1, 0, 0, 0], "target_position": [0, 0, 2000.5]}
    placed = frames | {"target_quaternion": [0.9, 0.1, 0.2, 0.3]}
    found: Line = {
        "format": "cpcal-handeye-result/8",
        "asked": {"center": placed, "reach": 100, "angle": None, "known": []},
    }
    found |= {"point": placed, "readings": [], "eps_hi": 1.5, "eps_lo": 0, "lower": [], "support": []}
    found |= {"ranges": {"certificate": "a"}, "tolerance": 1.5, "eps": 1.5}
    found |= {"outliers": 0, "left_out": [], "blamed": []}
    found |= {"classical": {"readings": [], "images": [{}]}}
    (folder / "handeye.json").write_text(json.dumps(found))


CASES |= {
    "a_leg_with_rows_of_many_terms": lambda folder: _leg(folder, 64, "gain", 1, 4000),
    "a_leg_of_a_short_model": lambda folder: _leg(folder, 64, "plain", 0, 4000),
    "a_campaign_of_32_megabytes": lambda folder: _result(folder, 120_000),
    "a_result_of_floats": lambda folder: _result(folder, 4, information=[0.5] * 2_000_000),
    "forms_of_long_numbers": forms_of_long_numbers,
    "a_study_of_many_points": a_study_of_many_points,
}


def target(folder: Path) -> Path:
    """The run in a folder, or the certificate that is there alone."""
    alone = list(folder.glob("*.cert.jsonl"))
    return folder if not alone or (folder / "result.json").exists() else alone[0]


def main(names: Annotated[list[str] | None, typer.Argument()] = None, work: int = 0) -> None:
    worst = False
    for name in asked(names, CASES):
        with tempfile.TemporaryDirectory() as folder:
            CASES[name](Path(folder))
            found = measured(target(Path(folder)), "--work", work)
        bad = found.seconds > SECONDS or found.megabytes > MEGABYTES or found.status not in (0, 1)
        worst |= bad
        last = (found.said.splitlines() or [""])[-1][:100]
        print(f"{name:40} {found.seconds:6.2f} s {found.megabytes:5.0f} MB  {'TOO MUCH' if bad else last}", flush=True)
    sys.exit(worst)


if __name__ == "__main__":
    run_by_hand(main)
