"""Methods that behave badly, for the harness to survive: named as `tests.benchmarks.fakes:Class`."""

import os
import signal
import sys
import time

from benchmarks.methods import TaskQuestion, Work
from benchmarks.runs import MethodAnswer, Unsupported


class Good:
    """Answers at once, and talks on stdout as some libraries do."""

    guarantee = "none"

    def missing(self) -> str | None:
        return None

    def prepare(self, question: TaskQuestion) -> Work:
        self.kind = question.task.kind
        return self.work

    def work(self) -> MethodAnswer:
        os.write(1, b"licence, banner, ...\n")
        return MethodAnswer(True, {"nodes": 3, "lo": 1.0, "hi": float("inf")}, self.kind)


class Absent(Good):
    def missing(self) -> str | None:
        return "is not installed"


class Refusing(Good):
    def prepare(self, question: TaskQuestion) -> Work:
        raise Unsupported("is not written for this")


class Raising(Good):
    def work(self) -> MethodAnswer:
        raise ArithmeticError("a pivot is zero")


class Crashing(Good):
    def work(self) -> MethodAnswer:
        print("segmentation fault", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGABRT)
        return MethodAnswer(True)


class Overrunning(Good):
    """Holds on for ever, its signals ignored and with a child of its own."""

    def work(self) -> MethodAnswer:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(600.0)
        return MethodAnswer(True)


class GivingUp(Good):
    """Says itself that it could not."""

    def work(self) -> MethodAnswer:
        return MethodAnswer(False, {}, "no idea")
