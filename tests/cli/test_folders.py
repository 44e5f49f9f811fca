"""Which folders a verb may write into."""

from __future__ import annotations

from pathlib import Path

from cpcal.cli.options import is_earlier_demo


def test_a_demo_may_replace_a_demo_and_nothing_else(tmp_path: Path) -> None:
    assert not is_earlier_demo(tmp_path)
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.toml").write_text("")
    (tmp_path / "run").mkdir()
    assert is_earlier_demo(tmp_path)
    (tmp_path / "mine.txt").write_text("")
    assert not is_earlier_demo(tmp_path)
