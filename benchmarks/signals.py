"""What a signal at a random moment leaves of a `certify`: the documented status, every finished leg, no process.

    python -m benchmarks.signals [--count 40] [--workers 1] [--kinds SIGINT SIGTERM SIGKILL] [--seed 1] [--legs 2,3]
        [--resumed 1] [--group]

Each time `cpcal certify` of some legs is begun, and gets the signal after a time between 0 and 1.1 times what an
undisturbed run takes. Then are counted: exit statuses (as a shell shows them: 128 + signal for a process that the
signal ended before Python could listen; apart those that came while Python itself began); tracebacks; runs whose
certificates `cpcal verify` refuses; processes that are left ten seconds later. Every stopped run (with `--resumed K`
every Kth) is then gone on with by --resume, and its certificates compared with those of the undisturbed run, byte by
byte. With --group the workers, and those that begin, are sent the signal too, as a terminal does. Linux only.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

import cpcal
from cpcal.cli.app import app

_BEFORE = "init_import_site"  # of the sentence with which Python ends


@dataclass(frozen=True)
class SignalledRun:
    """What every run is asked."""

    campaign: Path
    legs: str
    workers: int
    group: bool

    def command(self, run: Path, *more: str) -> list[str]:
        options = ["--legs", self.legs, "--delta", "200"]
        options += ["--support", "none", *(["--workers", str(self.workers)] if self.workers > 1 else []), *more]
        return ["certify", str(self.campaign), "-o", str(run), *options]


def certificates(run: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in run.glob("*.cert.jsonl")}


def left(session: int) -> list[int]:
    """Processes of a run, which has a session of its own, that still live."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            fields = (entry / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
        except (OSError, ValueError):
            continue
        if fields[0] != "Z" and int(fields[3]) == session:
            found.append(int(entry.name))
    return found


def begun(command: Sequence[str], said: Path) -> int:
    """The process of a run, whose output goes to a file."""
    with said.open("wb") as out:
        whole = [sys.executable, "-m", "cpcal", *command]
        return subprocess.Popen(whole, stdout=out, stderr=out, start_new_session=True).pid


def ended(pid: int) -> int:
    """The status as a shell shows it."""
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return status if status >= 0 else 128 - status


def one(asked: SignalledRun, run: Path, kind: signal.Signals, after: float) -> tuple[str, list[str]]:
    """The status of a run that is sent a signal, and what was wrong with it."""
    said = run.with_suffix(".said")
    pid = begun(asked.command(run), said)
    time.sleep(after)
    (os.killpg if asked.group else os.kill)(pid, kind)
    status = ended(pid)
    text = said.read_text(encoding="utf-8", errors="replace")
    if _BEFORE in text or ("Traceback" in text and f"{os.sep}cpcal{os.sep}" not in text):
        return "while Python began", []  # no line of ours had run
    wrong = []
    if status not in (0, 128 + kind):
        wrong.append(f"status {status}")
    if "Traceback" in text or "internal error" in text:
        wrong.append(f"traceback: {text[-600:]}")
    until = time.monotonic() + 10.0
    while left(pid) and time.monotonic() < until:
        time.sleep(0.1)
    if left(pid):
        wrong.append("processes are left")
    if (run / "result.json").exists():
        verified = CliRunner().invoke(app, ["verify", str(run)])
        if verified.exit_code == 1:
            wrong.append(f"refused by verify: {verified.output[-600:]}")
    return str(status), wrong


def resumed(asked: SignalledRun, run: Path, whole: dict[str, bytes]) -> list[str]:
    """Go on with a run; what is not as in an undisturbed one."""
    said = run.with_suffix(".again")
    status = ended(begun(asked.command(run, "--resume"), said))
    wrong = [] if status == 0 else [f"resumed with status {status}: {said.read_text(encoding='utf-8')[-300:]}"]
    return wrong if certificates(run) == whole else [*wrong, "other certificates after --resume"]


def undisturbed(asked: SignalledRun, folder: Path) -> tuple[float, dict[str, bytes]]:
    """How long it takes, once all is compiled, and its certificates."""
    run, took = folder / "whole", 0.0
    for _ in range(2):
        shutil.rmtree(run, ignore_errors=True)
        began = time.monotonic()
        if ended(begun(asked.command(run), folder / "said")):
            raise SystemExit((folder / "said").read_text(encoding="utf-8"))
        took = time.monotonic() - began
    return took, certificates(run)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=["SIGINT", "SIGTERM", "SIGKILL"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--legs", default="2,3")
    parser.add_argument("--resumed", type=int, default=1)
    parser.add_argument("--group", action="store_true")
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs, and theirs, ignore it
    moments = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small = cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)
        cpcal.save_campaign(small, folder / "campaign")
        asked = SignalledRun(folder / "campaign", given.legs, given.workers, given.group)
        took, whole = undisturbed(asked, folder)
        print(f"undisturbed: {took:.1f} s, {len(whole)} certificates; {given.workers} workers", flush=True)
        for kind in given.kinds:
            statuses, wrong = Counter[str](), Counter[str]()
            for k in range(given.count):
                run = folder / f"{kind}-{k}"
                after = moments.uniform(0.0, 1.1) * took
                status, found = one(asked, run, signal.Signals[kind], after)
                found += resumed(asked, run, whole) if k % given.resumed == 0 else []
                statuses[status] += 1
                wrong.update(found)
                if found:
                    print(f"  {kind} after {after:.2f} s: {'; '.join(found)}", flush=True)
                shutil.rmtree(run, ignore_errors=True)
            print(
                f"{kind}: {given.count} runs; statuses {dict(statuses)}; wrong {dict(wrong) or 'nothing'}", flush=True
            )


if __name__ == "__main__":
    main()
