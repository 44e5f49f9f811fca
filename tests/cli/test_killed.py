"""A certify that is killed, whenever: `verify` says unfinished, or accepts the whole answers of one run."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import cpcal
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import LOCK_NAME
from tests.cli.command import done
from tests.cli.command import run as command

OPTIONS = ("--legs", "1,2", "--delta", "0.5", "--gap", "1e-2", "--support", "none")
WRITES = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir"}  # audit events, each told before it happens
watching: list[Callable[[], None]] = []


def told(event: str, arguments: tuple[object, ...]) -> None:
    """Whoever watches is told of every write, but of none of its own."""
    if watching and event in WRITES and ".cpcal" not in str(arguments[0]):
        watcher = watching.pop()
        watcher()
        watching.append(watcher)


sys.addaudithook(told)  # for as long as the process lives; it does nothing while nobody watches


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("campaigns")
    for seed in (1, 2):
        small = cpcal.simulate(seed=seed, joint_error=1.0, factor=0.0, extremal=False, random_poses=12)
        cpcal.save_campaign(small, folder / str(seed))
    return [folder / "1", folder / "2"]


def certified(campaign: Path, run: Path) -> None:
    done("certify", campaign, "-o", run, *OPTIONS)


def digest(run: Path) -> str:
    return str(json.loads((run / "result.json").read_text(encoding="utf-8"))["campaign"]["sha256"])


def content(folder: Path) -> dict[str, bytes]:
    """What is in place, and whether anything stands aside."""
    files = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file() and p.name != LOCK_NAME}
    aside = any(p.is_dir() for p in folder.iterdir())
    return files | ({".draft": b""} if aside else {})


def left_by_the_dead(run: Path, aside: Path, work: Callable[[], None]) -> list[Path]:
    """What a SIGKILL before each write would leave in the folder: copies of it, each other than the one before."""
    found: list[Path] = []
    last: list[dict[str, bytes]] = [{}]

    def keep() -> None:
        now = content(run)
        if now != last[0]:
            last[0] = now
            found.append(Path(shutil.copytree(run, aside / str(len(found)))))

    watching.append(keep)
    try:
        work()
    finally:
        watching.clear()
    return found


def test_whenever_a_run_is_killed_it_leaves_no_mixture(campaigns: list[Path], tmp_path: Path) -> None:
    run = tmp_path / "run"
    certified(campaigns[0], run)
    old, new = digest(run), campaign_sha256(cpcal.load_campaign(campaigns[1]))
    states = left_by_the_dead(run, tmp_path / "aside", lambda: certified(campaigns[1], run))
    assert digest(run) == new
    seen = set()
    for state in states:
        said = command("verify", state)
        assert "Traceback" not in said.output
        assert "REFUSED" not in said.output
        if (state / "result.json").exists():
            assert said.exit_code == 0, said.output
            assert digest(state) in (old, new)
            seen.add(digest(state))
        else:
            assert said.exit_code == 2, said.output
            seen.add("unfinished")
    assert seen >= {old, "unfinished"}
    certified(campaigns[0], states[-1])  # whatever is left, the next run is whole
    assert digest(states[-1]) == old
    assert sorted(content(states[-1])) == ["campaign.json", *LEGS, *RANGES, *PAGES]


LEGS = [f"leg{leg}.{of}cert.jsonl" for leg in (1, 2) for of in ("", "passes.", "recommended.")]
RANGES, PAGES = ("ranges-leg1.cert.jsonl", "ranges-leg2.cert.jsonl"), ("report.html", "result.json")
