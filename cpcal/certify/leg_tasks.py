"""A question asked of each leg as a task of its own, here or wherever an executor does it.

What travels is the question and the answer, with the files that prove it: a worker needs no folder of ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pickle import PicklingError
from typing import Generic, TypeVar

from cpcal.certify.question import Question
from cpcal.common.errors import InputError, Problem
from cpcal.common.file_lock import scratch_folder
from cpcal.execution.executors import Here, Place, Processes
from cpcal.execution.outcomes import LostWorkerError, outcomes
from cpcal.execution.stopping import Stopped, asked
from cpcal.execution.threads import linear_algebra_on_one_thread

A = TypeVar("A")
T = TypeVar("T")

_RESUME, _AGAIN = "go on with --resume, which keeps what is answered", "run again"
HERE: Place = (Here(), 1)


@dataclass(frozen=True)
class TaskAnswer(Generic[A, T]):
    """What was found about one leg (or whatever was asked about), and the files that prove it, by name."""

    asked: A
    found: T
    files: Mapping[str, bytes]


def answers(
    question: Question, work: Callable[[Question, A], T], of: Sequence[A], place: Place = HERE
) -> Iterator[TaskAnswer[A, T]]:
    """`work(question, leg)` for each of `of`, as they are done; certificates are written aside and come as bytes.

    A single one is done here, and the boxes of its search are the tasks. Progress is told by work that is done here.
    When the process is asked to stop, those not begun are missing. Raises what the work raises, and InputError for a
    question that cannot travel.
    """
    kept = question.checkpoints is not None
    question, (executor, most) = placed(question, len(of), place)
    if not isinstance(executor, Here):
        question = replace(question, progress=None)
    if not isinstance(executor, Here | Processes):  # perhaps of another machine, without our folders
        question = replace(question, checkpoints=None)
    task = _Aside(work, question)
    for outcome in outcomes(executor, most, task, of):
        error = outcome.error
        if isinstance(error, PicklingError | AttributeError) and "pickle" in str(error).lower():
            remedy = "define it in a module that workers can import, or work here: leave out workers"
            raise InputError([Problem("model", f"cannot be sent to other processes ({error})", remedy)])
        if isinstance(error, LostWorkerError):
            about = getattr(outcome.task, "leg", outcome.task)
            raise LostWorkerError(f"leg {about}: {error}; {_RESUME if kept else _AGAIN}, perhaps with fewer workers")
        yield outcome.value


def placed(question: Question, count: int, place: Place) -> tuple[Question, Place]:
    """A question about so many legs, and where it is asked; about one it is here, and place is where boxes are decided.

    No process is begun for a search that closes in few boxes.
    """
    if count != 1 or isinstance(place[0], Here):
        return question, place
    return replace(question, place=place), HERE


@dataclass(frozen=True)
class _Aside(Generic[A, T]):
    """The work, with a folder of its own for certificates."""

    work: Callable[[Question, A], T]
    question: Question

    def __call__(self, asked_about: A) -> TaskAnswer[A, T]:
        reason = asked()
        if reason is not None:
            raise Stopped(reason)
        with linear_algebra_on_one_thread():
            return self._answer(asked_about)

    def _answer(self, asked_about: A) -> TaskAnswer[A, T]:
        if self.question.certificates is None:
            return TaskAnswer(asked_about, self.work(self.question, asked_about), {})
        with scratch_folder() as folder:
            found = self.work(replace(self.question, certificates=folder), asked_about)
            files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        return TaskAnswer(asked_about, found, files)
