"""Where tasks are done: here, in processes of this machine, or in any `concurrent.futures.Executor`.

Dask goes through the same door: a `distributed.Client` lends an executor. Tasks are functions that a module names, and
their arguments pure values, so that both travel.
"""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from cpcal.common.errors import InputError, Problem
from cpcal.solver.execution import stopping
from cpcal.solver.execution.stopping import Reason

T = TypeVar("T")

Place = tuple[Executor, int]  # and how many tasks it is given at a time

PATIENCE = 10.0  # seconds that workers have to end by themselves
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_LOGGER = logging.getLogger("cpcal")
_START = "forkserver" if sys.platform == "linux" else "spawn"  # safe beside threads
_EACH = 2  # tasks for each worker at a time, so that none is idle while its answer travels
_ELSEWHERE = 64  # workers that an executor is taken to have that does not tell


class Here(Executor):
    """Does a task in the moment in which it is submitted."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(Executor):
    """Processes of this machine. They end with this one however it ends, and hear of a stop from it alone.

    Each has a thread here that gives it one task after the other and waits for the answer. So whoever submits never
    waits, a process that ends costs the task that it was at and no other (BrokenExecutor), and the next task begins
    another process. Tasks are pickled in `submit`: what cannot travel comes to no thread. Nothing begins before the
    first task.

    loads  modules that tasks will need; on Linux the process that workers are forked from imports them, once for all,
           if it is these workers that it begins for
    """

    def __init__(self, count: int, loads: Sequence[str] = ()) -> None:
        self.count, self._loads = count, loads
        self._tasks: SimpleQueue[tuple[Future[Any], memoryview] | None] = SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._workers: list[_Worker] = []
        self._stopping = False

    @property
    def ready(self) -> bool:
        """Whether a process has begun; the first time that it is asked one begins."""
        if not self._threads:
            self.submit(os.getpid)
        return bool(self._workers)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            task = ForkingPickler.dumps((fn, args, kwargs))
        except Exception as error:
            future.set_exception(error)
            return future
        self._tasks.put((future, task))
        if len(self._threads) < self.count:
            if not self._threads:
                atexit.register(self.kill)
            self._threads.append(threading.Thread(target=self._lead, daemon=True))
            self._threads[-1].start()
        return future

    def ask_to_stop(self) -> None:
        """Tasks that are at work see it by `stopping.asked`."""
        self._stopping = True
        for worker in list(self._workers):
            worker.ask_to_stop()

    def kill(self) -> None:
        """End what is at work now."""
        for worker in list(self._workers):
            worker.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Give up every task. Those at work are asked to stop; ten seconds later, or after a second signal, their
        processes are killed."""
        with suppress(Empty):
            while True:
                item = self._tasks.get_nowait()
                if item is not None:
                    item[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        try:
            self.ask_to_stop()
            until = time.monotonic() + PATIENCE
            for thread in self._threads if wait else ():
                while thread.is_alive() and time.monotonic() < until and not stopping.insisted():
                    thread.join(0.05)
        finally:
            self.kill()
            for thread in self._threads if wait else ():  # each sees its process end
                thread.join(1.0)
            atexit.unregister(self.kill)

    def _lead(self) -> None:
        """A thread's work: tasks, one after the other, through a process that begins with the first of them."""
        if _START == "forkserver":
            with suppress(OSError):  # whoever begins a process is told
                resource_tracker.ensure_running()  # before the next line, since it lets signals through
        if hasattr(signal, "pthread_sigmask"):  # which processes inherit that begin here: Ctrl-C is for this one
            signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        worker: _Worker | None = None
        while (item := self._tasks.get()) is not None:
            future, task = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if worker is None:
                    worker = _Worker(self._loads)
                    self._workers.append(worker)
                    if self._stopping:  # it was asked while this one began
                        worker.ask_to_stop()
                answer = worker.answer(task)
            except Exception as error:
                if worker is not None:
                    self._end(worker)
                worker = None
                future.set_exception(BrokenExecutor(str(error)))
                continue
            try:
                well, found = pickle.loads(answer)
            except Exception as error:
                well, found = False, error
            (future.set_result if well else future.set_exception)(found)
            del item, future, task, answer, found  # a thread that waits holds nothing
        if worker is not None:
            self._end(worker)

    def _end(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.end()


class _Worker:
    """A process that does tasks. A second pipe tells it to stop, and by its end that nobody is there any more."""

    _beginning = threading.Lock()  # multiprocessing begins one at a time

    def __init__(self, loads: Sequence[str]) -> None:
        """Raises OSError, EOFError, RuntimeError where none can be begun."""
        context = multiprocessing.get_context(_START)
        self._tasks, tasks = context.Pipe()
        life, self._life = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(tasks, life))  # type: ignore[attr-defined]
        try:
            with self._beginning:
                if _START == "forkserver":
                    context.set_forkserver_preload(list(loads))
                self._process.start()
        except BaseException:
            self._tasks.close()
            self._life.close()
            raise
        finally:
            tasks.close()
            life.close()

    def answer(self, task: memoryview) -> bytes:
        """Raises OSError or EOFError where the process ends meanwhile."""
        self._tasks.send_bytes(task)
        return self._tasks.recv_bytes()

    def ask_to_stop(self) -> None:
        with suppress(OSError):
            self._life.send_bytes(b"stop")

    def kill(self) -> None:
        with suppress(OSError, ValueError, AttributeError):  # it has ended
            self._process.kill()

    def end(self) -> None:
        """Only by the thread that waits for its answers."""
        self.kill()
        self._tasks.close()
        self._life.close()
        self._process.join(PATIENCE)


def _work(tasks: Connection, life: Connection) -> None:
    """A worker's life: tasks until nobody sends any more."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    stop = threading.Event()
    stopping.from_now_on_asked_by(lambda: Reason.INTERRUPTED if stop.is_set() else None)
    threading.Thread(target=_listen, args=(life, stop), daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            tasks.send_bytes(_answer(tasks.recv_bytes()))


def _listen(life: Connection, stop: threading.Event) -> None:
    with suppress(EOFError, OSError):
        while True:
            life.recv_bytes()
            stop.set()
    os._exit(1)


def _answer(task: bytes) -> memoryview:
    """Whether it went well, and what came of it."""
    try:
        work, args, kwargs = pickle.loads(task)
        return ForkingPickler.dumps((True, work(*args, **kwargs)))
    except BaseException as error:
        error.add_note(traceback.format_exc())
        try:
            return ForkingPickler.dumps((False, error))
        except Exception:
            return ForkingPickler.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


@contextmanager
def executor_for(
    workers: int | None = None, scheduler: str | None = None, executor: Any = None, *, loads: Sequence[str] = ()
) -> Iterator[Place]:
    """The executor asked for, and how many tasks it is given at a time; none asked for: the work is done here.

    workers    processes of this machine; 1: none
    scheduler  address of a Dask scheduler, such as "tls://10.0.0.1:8786"
    executor   any executor, or a `distributed.Client`; it is not shut down
    loads      modules that the processes will need

    Raises InputError for more than one of them, or for a scheduler that does not answer.
    """
    if sum(choice is not None for choice in (workers, scheduler, executor)) > 1:
        remedy = "give one of workers, scheduler and executor"
        raise InputError([Problem("workers", "and another place to work are both given", remedy)])
    if executor is not None or scheduler is not None:
        with nullcontext(executor) if scheduler is None else _cluster(scheduler) as given:
            if hasattr(given, "get_executor"):
                yield given.get_executor(pure=False), _EACH * max(_ELSEWHERE, sum(given.ncores().values()))
            else:
                yield given, _EACH * _ELSEWHERE
    elif workers is None or workers == 1:
        yield Here(), 1
    else:
        pool = Processes(workers, loads)
        try:
            yield pool, _EACH * workers
        finally:
            pool.shutdown()


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError:
        remedy = "install it: pip install 'cpcal[distributed]'"
        raise InputError([Problem("scheduler", "a cluster needs dask.distributed", remedy)]) from None
    try:
        client = Client(address)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        remedy = "start `dask scheduler`, and give the address that it prints"
        what = f"no Dask scheduler answers there ({str(error)[:200]})"
        raise InputError([Problem(f"scheduler {address}", what, remedy)]) from None
    if not client.scheduler_info()["workers"]:
        _LOGGER.warning("cpcal: warning: the scheduler %s has no workers: the work waits for them", address)
    with _silent("distributed"):
        try:
            yield client
        finally:
            with suppress(OSError, RuntimeError):  # of one whose scheduler is gone
                client.close(timeout=PATIENCE)


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """No messages of a library and its parts: what fails is told by us, once."""
    known = [one for one in logging.root.manager.loggerDict if one == name or one.startswith(f"{name}.")]
    before = {one: logging.getLogger(one).level for one in known}
    for one in known:
        logging.getLogger(one).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for one, level in before.items():
            logging.getLogger(one).setLevel(level)


def dask_status(executor: Executor) -> str | None:
    """Of the Dask client that lent it ("running" while it has a scheduler); None: no Dask client did."""
    if type(executor).__module__.partition(".")[0] != "distributed":
        return None
    return str(executor._client.status)  # type: ignore[attr-defined]
