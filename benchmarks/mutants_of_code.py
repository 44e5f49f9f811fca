"""`python -m benchmarks.mutants_of_code`: do the tests notice small changes of the code that let out something false?

    python -m benchmarks.mutants_of_code [--area AREA] [--only WORDS] [--processes 1] [--seconds 300] [--log FILE]

`mutants_of_code.toml` lists the changes (mutants). Each names a folder, a pattern that occurs once below it, what
takes its place, what false statement that lets out, and the tests that must fail: paths and a -k expression. A mutant
whose pattern is gone, or is there twice, is an error that names it: it follows the code, or it leaves with the code.

Everything happens in copies of the tree in a temporary folder, machine code of kernels included. Tests that are named
must pass there without a change; with it they must fail (exit status 1 of pytest): a mutant that cannot be imported,
whose tests are not found, or do not end in time, is an error. A mutant that no test notices may have a `reason` why
that is right. Exit status 1 below a share of 95 % noticed, 2 for errors.

Why not mutmut or cosmic-ray: both generate every change of their operators, of which most change no statement, and run
one command for all. Neither keeps a list, says which tests must notice a change, or knows of kernels whose machine code
is made from the text of several files.
"""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks import run_by_hand

HERE = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")
SHARE = 0.95  # of all mutants must be noticed
_NOT_COPIED = shutil.ignore_patterns(".*", "build", "demo", "dist", "results*.json")
_NAMES = re.compile(r'(?:def test_\w+|"[^"\n]*")')  # of tests, or what may be a parameter's
_FAILED, _NO_END = 1, -1  # pytest's exit status where a test failed; ours where it was ended


class MutantError(Exception):
    """The list does not fit the code or the tests."""


@dataclass(frozen=True)
class Mutant:
    """A change of the code below a folder, the false statement that it lets out, and the tests that must fail."""

    area: str
    below: str
    pattern: str
    replacement: str
    false: str
    tests: str
    reason: str = field(default="", kw_only=True)

    def file(self, root: Path) -> Path:
        """The one file that holds the pattern, once. Raises MutantError."""
        folder = root / self.below
        files = sorted(folder.rglob("*.py")) if folder.is_dir() else [folder] if folder.is_file() else []
        places = [(path, path.read_text(encoding="utf-8").count(self.pattern)) for path in files]
        found = [(path, count) for path, count in places if count]
        if sum(count for _, count in found) != 1:
            where = ", ".join(f"{count} times in {path.relative_to(root)}" for path, count in found) or "nowhere"
            raise MutantError(f"{self.area}: {self.false}: the pattern is {where} below {self.below}: {self.pattern!r}")
        return found[0][0]

    def apply(self, root: Path) -> None:
        """Change the file below `root`, and leave no bytecode that could be taken for it."""
        path = self.file(root)
        changed = path.read_text(encoding="utf-8").replace(self.pattern, self.replacement)
        path.unlink()
        path.write_text(changed, encoding="utf-8")
        for old in path.parent.glob(f"__pycache__/{path.stem}.*.pyc"):
            old.unlink()


@dataclass(frozen=True)
class Outcome:
    """What the tests said: the first that failed, "" where they passed."""

    mutant: Mutant
    noticed_by: str


def read(path: Path = LIST) -> list[Mutant]:
    """The list. Each table `[[area]]` of the file is a mutant of that area."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    mutants = [Mutant(area=area, **entry) for area, entries in tables.items() for entry in entries]
    names = [mutant.false for mutant in mutants]
    if twice := {name for name in names if names.count(name) > 1}:
        raise MutantError(f"two mutants say the same: {', '.join(sorted(twice))}")
    return mutants


def misplaced(mutants: Iterable[Mutant], root: Path = HERE) -> list[str]:
    """What is wrong with the places that the mutants name."""
    errors = []
    for mutant in mutants:
        try:
            mutant.file(root)
        except MutantError as error:
            errors.append(str(error))
        named = (part for part in shlex.split(mutant.tests) if part.startswith(("tests/", "docs/")))
        paths = [root / part.partition("::")[0] for part in named]
        gone = [str(path.relative_to(root)) for path in paths if not path.exists()]
        gone = gone or _unknown_words(mutant.tests, paths)
        errors += [f"{mutant.area}: {mutant.false}: {part} is not there" for part in gone]
    return errors


def _unknown_words(tests: str, paths: Iterable[Path]) -> list[str]:
    """The words after -k, where no test that the paths hold can have one of them in its name."""
    words = re.findall(r"\w+", tests.partition(" -k ")[2])
    files = [file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py"))]
    names = " ".join(name for file in files for name in _NAMES.findall(file.read_text("utf-8"))).lower()
    return [] if not words or any(word.lower() in names for word in words) else [f"a test called {' '.join(words)}"]


def outcome(mutant: Mutant, original: Path, seconds: float) -> Outcome:
    """Of the mutant's tests in a copy of `original`."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        root = copy_of(original, Path(folder) / "tree", linked=True)
        mutant.apply(root)
        status, printed = run_tests(mutant.tests, root, seconds)
    if status not in (0, _FAILED):
        said = f"no end in {seconds:g} s" if status == _NO_END else f"pytest ended with {status}\n{printed[-2000:]}"
        raise MutantError(f"{mutant.area}: {mutant.false}: {said}")
    failed = [line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return Outcome(mutant, failed[0].split(" ")[1] if failed else "" if status == 0 else "a test")


def run_tests(tests: str, root: Path, seconds: float) -> tuple[int, str]:
    """Pytest's exit status for these tests of the tree at `root`, and what it printed; -1 where it was ended."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=line", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(root), "CPCAL_QUIET": "1"}
    with subprocess.Popen(
        [*command, *shlex.split(tests)], cwd=root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, start_new_session=True,  # so that processes which tests began end with them
    ) as process:  # fmt: skip
        try:
            printed, _ = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return _NO_END, process.communicate()[0]
        return process.returncode, printed


def copy_of(original: Path, root: Path, *, linked: bool = False) -> Path:
    """The tree, with its machine code. `linked`: files have two names; what is written anew has its own."""
    shutil.copytree(original, root, ignore=_NOT_COPIED, copy_function=os.link if linked else shutil.copy2)
    return root


def unchanged_failures(mutants: Iterable[Mutant], original: Path, seconds: float, processes: int = 1) -> dict[str, str]:
    """The named tests that do not pass in the tree as it is, which would notice anything: how they end."""
    named = sorted({mutant.tests for mutant in mutants})
    with ThreadPoolExecutor(processes) as pool:
        ended = pool.map(lambda tests: run_tests(tests, original, seconds), named)
        return {
            tests: f"{tests}: pytest ends with {status} without a change\n{printed[-2000:]}"
            for tests, (status, printed) in zip(named, ended, strict=True)
            if status
        }


def table(outcomes: Sequence[Outcome]) -> str:
    """By area: mutants, how many were noticed, and those that were not, each with its reason."""
    lines = ["| area | mutants | noticed | not noticed |", "| --- | --- | --- | --- |"]
    for area in dict.fromkeys(found.mutant.area for found in outcomes):
        mine = [found for found in outcomes if found.mutant.area == area]
        lost = [found.mutant for found in mine if not found.noticed_by]
        said = "; ".join(f"{mutant.false} ({mutant.reason or 'NO REASON'})" for mutant in lost)
        lines.append(f"| {area} | {len(mine)} | {len(mine) - len(lost)} | {said} |")
    noticed = sum(bool(found.noticed_by) for found in outcomes)
    lines.append(f"| all | {len(outcomes)} | {noticed} ({noticed / len(outcomes):.1%}) | |")
    return "\n".join(lines)


def main(area: str = "", only: str = "", processes: int = 1, seconds: float = 300.0, log: Path | None = None) -> None:
    """Mutants of an area alone, or whose false statement holds the words `only`; `processes` at a time, tests ended
    after `seconds`. `log` gets lines of JSON: mutant and the test that noticed it."""
    mutants = [m for m in read() if area in ("", m.area) and only in m.false]
    errors = misplaced(mutants)
    if errors or not mutants:
        print("\n".join(errors) or "no mutant is called so", file=sys.stderr)
        sys.exit(2)
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        original = copy_of(HERE, Path(folder) / "tree")
        failing = unchanged_failures(mutants, original, seconds, processes)
        errors += failing.values()
        mutants = [mutant for mutant in mutants if mutant.tests not in failing]
        with ThreadPoolExecutor(processes) as pool:
            for mutant, job in [(m, pool.submit(outcome, m, original, seconds)) for m in mutants]:
                try:
                    found = job.result()
                except MutantError as error:
                    errors.append(str(error))
                    continue
                outcomes.append(found)
                said = f"{mutant.area}: {mutant.false}: {found.noticed_by or 'NOT NOTICED'}"
                print(said, file=sys.stderr, flush=True)
                if log:
                    with log.open("a", encoding="utf-8") as lines:
                        lines.write(json.dumps({"mutant": mutant.false, "noticed_by": found.noticed_by}) + "\n")
    if outcomes:
        print(table(outcomes))
    print("\n".join(errors), file=sys.stderr)
    noticed = sum(bool(found.noticed_by) for found in outcomes)
    sys.exit(2 if errors else int(noticed < SHARE * len(outcomes)))


if __name__ == "__main__":
    run_by_hand(main)
