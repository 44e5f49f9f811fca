"""Where tasks are done: here, in processes of this machine, or in any `concurrent.futures.Executor`.

Dask goes through the same door: a `distributed.Client` lends an executor. Tasks are functions that a module names, and
their arguments pure values, so that both travel.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import cached_property
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from cpcal.common.errors import InputError, Problem
from cpcal.execution import stopping
from cpcal.execution.stopping import Reason

T = TypeVar("T")

Place = tuple[Executor, int]  # and how many tasks it is given at a time

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_LOGGER = logging.getLogger("cpcal")
_START = "forkserver" if sys.platform == "linux" else "spawn"  # safe beside threads
_ELSEWHERE = 64  # workers that an executor is taken to have that does not tell


def at_a_time(workers: int) -> int:
    """How many tasks so many workers are given: two each, so that none is idle while its answer travels."""
    return 2 * workers


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

    None begins before the first task. A pool in which a process was killed is broken; `renew` makes another.

    loads  modules that tasks will need; on Linux the process that workers are forked from imports them, once for all,
           if it is these workers that it begins for
    """

    def __init__(self, count: int, loads: Sequence[str] = ()) -> None:
        self.count, self._loads = count, loads
        self._context = multiprocessing.get_context(_START)
        self._pool: ProcessPoolExecutor | None = None
        self._first: threading.Thread | None = None
        self._holds: Connection | None = None  # what a pool's workers live by

    @cached_property
    def _stop(self) -> Any:
        return self._context.Event()

    @property
    def ready(self) -> bool:
        """Whether a task that is submitted now is taken at once; the first time that it is asked a process begins."""
        if self._first is None:
            self._first = threading.Thread(target=self._begun, daemon=True)
            self._first.start()
        return not self._first.is_alive()

    def _begun(self) -> None:
        with suppress(OSError, RuntimeError, EOFError):  # whoever submits then is told
            self.submit(os.getpid)

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        if self._pool is None and _START == "forkserver":
            resource_tracker.ensure_running()  # it lets signals through again when it begins, so not in the block
        with _without_signals():  # which a new process inherits: Ctrl-C is for this one
            if self._pool is None:
                if self._loads and _START == "forkserver":
                    self._context.set_forkserver_preload(list(self._loads))
                ends, self._holds = self._context.Pipe(duplex=False)
                given = (self._stop, ends)
                self._pool = ProcessPoolExecutor(self.count, self._context, initializer=_begin, initargs=given)
            return self._pool.submit(fn, *args, **kwargs)

    def ask_to_stop(self) -> None:
        """Tasks that are at work see it by `stopping.asked`."""
        if self._pool is not None:
            self._stop.set()

    def renew(self) -> None:
        """Another pool. What is left of this one's workers ends: nobody takes what they answer."""
        self.shutdown(wait=False, cancel_futures=True)
        self._let_go()
        self._pool = None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        if wait and self._first is not None:
            self._first.join()
        if self._pool is not None:
            self._pool.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self._let_go()

    def _let_go(self) -> None:
        if self._holds is not None:
            self._holds.close()


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
    if executor is not None:
        if hasattr(executor, "get_executor"):
            yield _through(executor)
        else:
            yield executor, at_a_time(_ELSEWHERE)
    elif scheduler is not None:
        with _cluster(scheduler) as client:
            yield _through(client)
    elif workers is None or workers == 1:
        yield Here(), 1
    else:
        pool = Processes(workers, loads)
        try:
            yield pool, at_a_time(workers)
        except BaseException:
            pool.ask_to_stop()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


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
    with client, _silent("distributed"):
        yield client


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


def _through(client: Any) -> Place:
    """Of a Dask client."""
    return client.get_executor(pure=False), at_a_time(max(_ELSEWHERE, sum(client.ncores().values())))


def of_dask(executor: Executor) -> bool:
    """Whether a Dask client lent it."""
    return type(executor).__module__.partition(".")[0] == "distributed"


def _begin(stop: Any, ends: Connection) -> None:
    """In each process of a pool: the coordinator tells it to stop; the end of either ends it."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    stopping.from_now_on_asked_by(lambda: Reason.INTERRUPTED if stop.is_set() else None)
    threading.Thread(target=_end_with, args=(ends,), daemon=True).start()


def _end_with(pool: Connection) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel, pool])
        os._exit(1)


@contextmanager
def _without_signals() -> Iterator[None]:
    """Signals wait until the end of the block."""
    mask = getattr(signal, "pthread_sigmask", None)  # of POSIX only
    if mask is None:
        yield
        return
    before = mask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)
