"""One run, in this process: a job comes in on stdin, "ready" and then the run go out on stdout, both JSON lines.

What a peer prints goes to stderr. Only the task itself is timed.
"""

from __future__ import annotations

import gc
import json
import math
import os
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from benchmarks.methods import TaskQuestion, method
from benchmarks.problems import problem
from benchmarks.records import ANSWERED, FAILED, SKIPPED, TIMEOUT, UNDECIDED, MethodAnswer, Run
from benchmarks.tasks import Task, Unsupported

_NEARLY = 0.95  # who gives up this close to the limit gave up because of it


def perform(job: dict[str, Any], tell: TextIO) -> Run:
    """Do what `job` says; its failure is a result."""
    name = (job["problem"], job["task"], job["method"])
    try:
        asked = method(job["method"])
        lacking = asked.missing()
        if lacking is not None:
            return Run(*name, SKIPPED, note=lacking)
        data = None if job["data"] is None else Path(job["data"])
        question = TaskQuestion(problem(job["problem"], data), Task.named(job["task"]), job["eps"], job["limit"])
        work = asked.prepare(question)
        print(json.dumps("ready"), file=tell, flush=True)
        gc.collect()
        began, cpu = time.perf_counter(), time.process_time()
        answer = work()
        seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    except (Unsupported, FileNotFoundError) as reason:
        return Run(*name, SKIPPED, note=str(reason))
    except Exception as error:
        return Run(*name, FAILED, note=f"{type(error).__name__}: {error}"[:300])
    status = _status(answer, seconds, job["limit"])
    if answer.cpu is not None:
        seconds, cpu = math.nan, answer.cpu
    return Run(*name, status, seconds, cpu, answer.figures, answer.note)


def _status(answer: MethodAnswer, seconds: float, limit: float) -> str:
    if seconds > limit or (not answer.answered and seconds > _NEARLY * limit):
        return TIMEOUT
    return ANSWERED if answer.answered else UNDECIDED


def main() -> None:
    tell = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    run = perform(json.loads(sys.stdin.read()), tell)
    print(json.dumps(asdict(run)), file=tell, flush=True)
    os._exit(0)  # whatever a peer would still like to do


if __name__ == "__main__":
    main()
