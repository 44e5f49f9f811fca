"""Folders of answers: never two writers, never a file of somebody else; tests/cli/test_killed.py: never a mixture."""

import os
import shutil
from pathlib import Path

import pytest

from cpcal import InputError
from cpcal.files.run_folder import LOCK_NAME, RUN, answers_into, check_replaceable

NAMES = ("campaign.json", "leg1.cert.jsonl", "leg2.cert.jsonl", "report.html", "result.json")
PAGE = '<!doctype html>\n<meta name="generator" content="cpcal">'


def fill(folder: Path, word: str) -> None:
    for name in NAMES:
        json = f'{{"format": "cpcal-x", "word": "{word}"}}'
        (folder / name).write_text(PAGE + word if name.endswith("html") else json)


def words(folder: Path) -> dict[str, str]:
    """What each file is of; hidden ones left out."""
    texts = {path.name: path.read_text() for path in folder.iterdir() if not path.name.startswith(".")}
    return {name: "new" if "new" in text else "old" for name, text in texts.items()}


def test_answers_come_all_at_once(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "run"
    with answers_into(folder, RUN) as draft:
        fill(draft, "new")
        assert not words(folder)
    assert words(folder) == dict.fromkeys(NAMES, "new")
    with answers_into(folder, RUN) as draft:
        (draft / "leg3.cert.jsonl").write_text("")
    assert os.listdir(folder) == ["leg3.cert.jsonl"]  # what is older is gone


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


def test_a_link_in_a_drafts_place_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even one who guesses the draft's name cannot have a file outside overwritten."""
    run, outside = tmp_path / "run", tmp_path / "outside"
    for folder in (run, outside):
        folder.mkdir()
    fill(outside, "precious")
    os.symlink(outside, run / ".guessed.draft")
    monkeypatch.setattr("cpcal.files.run_folder.draft_name", lambda: ".guessed.draft")
    with pytest.raises(InputError, match="cannot be written"), answers_into(run, RUN) as draft:
        fill(draft, "new")
    assert words(outside) == dict.fromkeys(NAMES, "old")
    assert not words(run)


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
