"""`python -m benchmarks.mutations`: files damaged at random are refused with a sentence, or mean what they say.

    python -m benchmarks.mutations [SUBJECT ...] [--count 10000] [--seed 1] [--log FILE]

Each subject is a small set of good files and what cpcal reads out of them. A mutation is one of `mutants.py`, of one
file that is drawn at random; seeded, so that number k of a seed is always the same. The outcome is

    refused    InputError, Refused or an exit status of 1 or 2 with a message
    same       what was read is what the good files say
    other      an input that states something else, and says so: it is read back the same when it is saved, and (a
               campaign) has another SHA-256, so that no certificate of the good one is taken for it
    CHANGED    a certificate or a result that is accepted with other claims: must not happen
    TRACEBACK  any other exception: must not happen

Exit status 1 when one of the last two happened. The log has a line for each acceptance: number, file, mutation, outcome
and why it is harmless.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.mutants import mutated
from benchmarks.mutation_subjects import SUBJECTS, Refusal, Subject
from cpcal.common.errors import InputError

BAD = ("CHANGED", "TRACEBACK")


@dataclass(frozen=True)
class Outcome:
    """What became of one mutation."""

    number: int
    file: str
    mutation: str
    kind: str
    why: str
    seconds: float


def outcomes(subject: Subject, folder: Path, count: int, seed: int) -> Iterator[Outcome]:
    """The outcomes of `count` mutations of a subject, whose files are written into the empty `folder`."""
    subject.write(folder)
    files = {p: p.read_bytes() for p in sorted(folder.glob(subject.mutated)) if p.is_file()}
    good = subject.read(folder)
    for number in range(count):
        rng = random.Random(f"{seed}/{subject.name}/{number}")
        path = rng.choice(list(files))
        name, content = mutated(rng, files[path])
        path.write_bytes(content)
        began = time.monotonic()
        kind, why = _outcome(subject, folder, good)
        path.write_bytes(files[path])
        yield Outcome(number, path.name, name, kind, why, time.monotonic() - began)


def _outcome(subject: Subject, folder: Path, good: Any) -> tuple[str, str]:
    try:
        found = subject.read(folder)
        if found == good:
            return "same", "everything that is read is as in the good files"
        why = subject.harmless(good, found)
        return ("CHANGED", "what is claimed differs") if why is None else ("other", why)
    except Refusal as refusal:
        return "refused", str(refusal)
    except InputError as error:
        named = error.problems and all(p.where and p.what and p.remedy for p in error.problems)
        return ("refused", str(error.problems[0])) if named else ("TRACEBACK", "a refusal without a remedy")
    except Exception as error:
        return "TRACEBACK", f"{type(error).__name__}: {error}"


def survey(name: str, count: int, seed: int, log: Callable[[str], object]) -> Counter[str]:
    """How many mutations of a subject had which outcome; every acceptance and every failure is logged."""
    found: Counter[str] = Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for outcome in outcomes(SUBJECTS[name], Path(folder), count, seed):
            found[outcome.kind] += 1
            slowest = max(slowest, outcome.seconds)
            if outcome.kind != "refused":
                log(json.dumps({"subject": name, "seed": seed, **vars(outcome)}))
    counts = ", ".join(f"{times:,} {kind}" for kind, times in sorted(found.items()))
    print(f"{name}: {count:,} mutations, seed {seed}: {counts}; slowest {slowest:.2f} s", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Damage files at random and see that none is misunderstood.")
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=f"of {', '.join(SUBJECTS)}; default: all")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, default=Path("mutations.jsonl"))
    options = parser.parse_args()
    with options.log.open("w", encoding="utf-8", buffering=1) as file:
        total: Counter[str] = Counter()
        for name in options.subjects or SUBJECTS:
            total += survey(name, options.count, options.seed, lambda line: file.write(line + "\n"))
    sys.exit(1 if any(total[kind] for kind in BAD) else 0)


if __name__ == "__main__":
    main()
