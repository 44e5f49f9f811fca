"""No number is only stated: every change of a file that `cpcal verify` reads is refused, or it is information."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.damaged_runs import RUNS
from cpcal.checker import Refused, check
from cpcal.cli.verify import statements
from cpcal.common.errors import InputError
from tests.every_key import FILES, accepted_changes, unlisted_keys
from tests.remembered import verify_once

Verify = Callable[[], bool]
Genuine = Callable[[str, Path], None]


@pytest.fixture
def verified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Verify:
    """Whether `cpcal verify` accepts all of `run`, without its command line, which takes as long as a verification."""
    verify_once(monkeypatch)

    def accepted() -> bool:
        try:
            return all(accepted for accepted, _ in statements(tmp_path / "run"))
        except InputError:
            return False

    return accepted


# below, and those of hand-eye runs in tests/models
ELSEWHERE = ("pose sets", "solve", "fits", "hand-eye", "uncertain hand-eye", "wrong images")


EXTENT = [False, pytest.param(True, marks=pytest.mark.nightly)]  # a key in one place and way, or wherever it stands


@pytest.mark.parametrize("thorough", EXTENT)
@pytest.mark.parametrize("kind", [kind for kind in RUNS if kind not in ELSEWHERE])
def test_every_change_outside_of_the_information_is_refused(kind, thorough, tmp_path, verified, genuine_run):
    genuine_run(kind, tmp_path)
    assert verified()
    folder = tmp_path / "run" / ("lateral" if kind == "compare" else "")
    (file,) = (folder / name for name in FILES if (folder / name).exists())
    assert unlisted_keys(file) == []
    assert list(accepted_changes(file, verified, thorough=thorough)) == []


@pytest.mark.parametrize("thorough", EXTENT)
def test_every_change_of_what_a_pose_set_states_is_refused(thorough, tmp_path, verified, genuine_run):
    genuine_run("pose sets", tmp_path)
    assert verified()
    file = tmp_path / "run" / "one.pose.json"
    assert list(accepted_changes(file, verified, but="chains", thorough=thorough)) == []


def test_no_key_of_a_certificate_is_read_in_silence(tmp_path: Path, genuine_run: Genuine) -> None:
    """What header or claims say otherwise is refused, or said to be proved; the constraints are its own."""
    genuine_run("solve", tmp_path)
    path = tmp_path / "run" / "it.cert.jsonl"
    good, text = check(path), path.read_text(encoding="utf-8")
    lines = text.splitlines()
    claims = next(k for k, line in enumerate(lines) if '"claims"' in line or '"infeasible"' in line)

    def unnoticed(number: int) -> Iterator[str]:
        line = tmp_path / "line.json"
        line.write_text(lines[number], encoding="utf-8")

        def same() -> bool:
            path.write_text("\n".join([*lines[:number], line.read_text(), *lines[number + 1 :]]) + "\n")
            try:
                return check(path) == good
            except Refused:
                return False

        yield from accepted_changes(line, same)

    assert list(unnoticed(0)) == []
    assert list(unnoticed(claims)) == []
