"""Folders of answers: never a mixture, never two writers, never a file that somebody else wrote."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cpcal import InputError
from cpcal.files.run_folder import LOCK_NAME, RUN, answers_into, check_replaceable, unfinished

NAMES = ("campaign.json", "leg1.cert.jsonl", "leg2.cert.jsonl", "report.html", "result.json")
PAGE = '<!doctype html>\n<meta name="generator" content="cpcal">'

# dies by SIGKILL at the moment named: inside the block, or when the n-th file is removed or moved
_KILLED = """
import os, signal, sys
from pathlib import Path
import cpcal.files.run_folder as run_folder
from tests.files.test_run_folder import fill

folder, moment = Path(sys.argv[1]), sys.argv[2]
left = [int(moment.split()[1]) if " " in moment else -1]

def dies(name):
    real = getattr(Path, name)
    def act(self, *given, **named):
        if placing and moment.startswith(name):
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
        return real(self, *given, **named)
    return act

placing = []
for name in ("unlink", "replace"):
    setattr(Path, name, dies(name))
real = run_folder.put_in_place
run_folder.put_in_place = lambda *given, **named: (placing.append(1), real(*given, **named))
with run_folder.answers_into(folder, run_folder.RUN) as draft:
    fill(draft, "new")
    if moment == "inside":
        os.kill(os.getpid(), signal.SIGKILL)
"""


def fill(folder: Path, word: str) -> None:
    for name in NAMES:
        json = f'{{"format": "cpcal-x", "word": "{word}"}}'
        (folder / name).write_text(PAGE + word if name.endswith("html") else json)


def words(folder: Path) -> dict[str, str]:
    """What each file is of; hidden ones left out."""
    texts = {path.name: path.read_text() for path in folder.iterdir() if not path.name.startswith(".")}
    return {name: "new" if "new" in text else "old" for name, text in texts.items()}


@pytest.mark.parametrize(
    "moment", ["inside", "unlink 0", "unlink 2", "unlink 4", "replace 0", "replace 2", "replace 4"]
)
def test_a_kill_leaves_the_old_answers_or_none(tmp_path: Path, moment: str) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    fill(folder, "old")
    command = [sys.executable, "-c", _KILLED, str(folder), moment]
    done = subprocess.run(command, check=False, cwd=Path(__file__).parents[2], capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    found = words(folder)
    whole = found == dict.fromkeys(NAMES, "old")
    assert whole or "result.json" not in found
    assert whole == (moment in ("inside", "unlink 0"))
    assert unfinished(folder)  # so that verify says what happened
    with answers_into(folder, RUN) as draft:  # the dead hold no lock
        fill(draft, "new")
    assert words(folder) == dict.fromkeys(NAMES, "new")
    assert sorted(os.listdir(folder)) == sorted(NAMES)


def test_answers_come_all_at_once(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "run"
    with answers_into(folder, RUN) as draft:
        fill(draft, "new")
        assert not words(folder)
    assert words(folder) == dict.fromkeys(NAMES, "new")
    with answers_into(folder, RUN) as draft:
        (draft / "leg3.cert.jsonl").write_text("")
    assert os.listdir(folder) == ["leg3.cert.jsonl"]  # what is older is gone


def test_a_failure_keeps_the_older_answers(tmp_path: Path) -> None:
    fill(tmp_path, "old")
    with pytest.raises(ZeroDivisionError, match="division"), answers_into(tmp_path, RUN) as draft:
        fill(draft, str(1 // 0))
    assert words(tmp_path) == dict.fromkeys(NAMES, "old")
    with pytest.raises(ZeroDivisionError, match="division"), answers_into(tmp_path / "new", RUN) as draft:
        fill(draft, str(1 // 0))
    assert not (tmp_path / "new").exists()


def test_a_second_run_is_refused_while_the_first_lives(tmp_path: Path) -> None:
    with answers_into(tmp_path, RUN) as draft:
        fill(draft, "new")
        with pytest.raises(InputError, match="another run of cpcal"), answers_into(tmp_path, RUN):
            pass
    assert words(tmp_path) == dict.fromkeys(NAMES, "new")
    assert not (tmp_path / LOCK_NAME).exists()


@pytest.mark.parametrize("name", NAMES)
def test_files_of_others_are_neither_replaced_nor_removed(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("precious")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not written by cpcal"), answers_into(tmp_path, RUN):
        pass
    assert sorted(os.listdir(tmp_path)) == sorted([name, "notes.txt"])
    assert (tmp_path / name).read_text() == "precious"


def test_a_link_is_not_taken_for_an_answer(tmp_path: Path) -> None:
    (tmp_path / "outside.json").write_text('{"format": "cpcal-x"}')
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "result.json").symlink_to("../outside.json")
    with pytest.raises(InputError, match="not written by cpcal"):
        check_replaceable(tmp_path / "run", RUN)


def test_a_link_in_the_locks_place_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / LOCK_NAME).symlink_to("elsewhere")
    with pytest.raises(InputError, match="cannot be written"), answers_into(tmp_path, RUN):
        pass
    assert os.listdir(tmp_path) == [LOCK_NAME]


def test_a_campaign_is_no_place_for_answers(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text("")
    with pytest.raises(InputError, match="folder of a campaign"), answers_into(tmp_path, RUN):
        pass
    assert os.listdir(tmp_path) == ["campaign.toml"]


def test_a_folder_that_is_taken_away_is_said_to_be(tmp_path: Path) -> None:
    def taken_away(folder: Path) -> None:
        with answers_into(folder, RUN) as draft:
            shutil.rmtree(folder)
            draft.mkdir(parents=True)
            fill(draft, "new")

    with pytest.raises(InputError, match="taken away"):
        taken_away(tmp_path / "run")
    assert not (tmp_path / "run" / "result.json").exists()
