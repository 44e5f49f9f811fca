"""What a signal at a random moment leaves of a `certify`: the documented status, every finished leg, no process.

    python -m benchmarks.signals [--count 40] [--workers 1] [--kinds SIGINT SIGTERM SIGKILL] [--seed 1]

Each time `cpcal certify` of three legs is begun, and gets the signal after a time between 0 and 1.1 times what an
undisturbed run takes. Then are counted: exit statuses (as a shell shows them: 128 + signal for a process that the
signal ended before Python could listen); tracebacks; runs whose certificates `cpcal verify` refuses; legs that the log
says were answered and that neither the result nor the checkpoint holds; processes that are left ten seconds later.
Every stopped run is then gone on with by --resume, and its certificates compared with those of the undisturbed run,
byte by byte. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import cpcal
from cpcal.certify.checkpoints import FOLDER

MARK = "CPCAL_BENCHMARK_RUN"  # in the environment of every process of a run


def command(campaign: Path, run: Path, workers: int, *more: str) -> list[str]:
    options = ["--legs", "1,2,3", "--delta", "200", "--log", str(run.with_suffix(".log")), *more]
    options += ["--workers", str(workers)] if workers > 1 else []
    return [sys.executable, "-m", "cpcal", "certify", str(campaign), "-o", str(run), *options]


def certificates(run: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in run.glob("*.cert.jsonl")}


def answered(run: Path) -> set[int]:
    """The legs that the log of a run says were answered, in the moment in which they were."""
    log = run.with_suffix(".log")
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    events = [json.loads(line) for line in lines if line.endswith("}")]
    return {event["leg"] for event in events if event["event"] == "kept"}


def held(run: Path) -> set[int]:
    """The legs that the result, or the checkpoint, holds."""
    legs = {int(path.name[3 : -len(".answer")]) for path in (run / FOLDER).glob("*.answer")}
    if (run / "result.json").exists():
        legs |= {leg.leg for leg in cpcal.load_result(run).legs}
    return legs


def left(mark: str) -> list[int]:
    """Processes of a run that still live."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                    state = (entry / "stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
                    found += [int(entry.name)] if state != "Z" else []
            except OSError:
                continue
    return found


def one(campaign: Path, run: Path, workers: int, kind: signal.Signals, after: float) -> tuple[str, list[str]]:
    """The status of a run that is sent a signal, and what was wrong with it."""
    mark = f"{os.getpid()}-{run.name}"
    process = subprocess.Popen(
        command(campaign, run, workers),
        env=os.environ | {MARK: mark},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(after)
    process.send_signal(kind)
    _, said = process.communicate(timeout=300)
    status = process.returncode if process.returncode >= 0 else 128 - process.returncode
    wrong = []
    if status not in (0, 128 + kind):
        wrong.append(f"status {status}")
    if "Traceback" in said and process.returncode >= 0:
        wrong.append("traceback")
    until = time.monotonic() + 10.0
    while left(mark) and time.monotonic() < until:
        time.sleep(0.1)
    if left(mark):
        wrong.append("processes are left")
    if answered(run) - held(run):
        wrong.append("a leg is lost")
    if (run / "result.json").exists():
        verify = [sys.executable, "-m", "cpcal", "verify", str(run)]
        if subprocess.run(verify, capture_output=True, text=True, check=False).returncode == 1:
            wrong.append("refused by verify")
    return str(status), wrong


def resumed(campaign: Path, run: Path, workers: int, whole: dict[str, bytes]) -> list[str]:
    """Go on with a run; what is not as in an undisturbed one."""
    again = subprocess.run(command(campaign, run, workers, "--resume"), capture_output=True, text=True, check=False)
    wrong = [] if again.returncode == 0 else [f"resumed with status {again.returncode}: {again.stderr[-300:]}"]
    return wrong if certificates(run) == whole else [*wrong, "other certificates after --resume"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=["SIGINT", "SIGTERM", "SIGKILL"])
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs, and theirs, ignore it
    moments = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small = cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)
        cpcal.save_campaign(small, folder / "campaign")
        run = folder / "whole"
        subprocess.run(command(folder / "campaign", run, given.workers), capture_output=True, check=True)
        began = time.monotonic()
        shutil.rmtree(run)
        subprocess.run(command(folder / "campaign", run, given.workers), capture_output=True, check=True)
        took, whole = time.monotonic() - began, certificates(run)
        print(f"undisturbed: {took:.1f} s, {len(whole)} certificates; {given.workers} workers", flush=True)
        for kind in given.kinds:
            statuses, wrong = Counter[str](), Counter[str]()
            for k in range(given.count):
                run = folder / f"{kind}-{k}"
                after = moments.uniform(0.0, 1.1) * took
                status, found = one(folder / "campaign", run, given.workers, signal.Signals[kind], after)
                found += resumed(folder / "campaign", run, given.workers, whole)
                statuses[status] += 1
                wrong.update(found)
                if found:
                    print(f"  {kind} after {after:.2f} s: {'; '.join(found)}", flush=True)
                shutil.rmtree(run)
            print(
                f"{kind}: {given.count} runs; statuses {dict(statuses)}; wrong {dict(wrong) or 'nothing'}", flush=True
            )


if __name__ == "__main__":
    main()
