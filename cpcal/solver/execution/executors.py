"""Where tasks are done: here, in processes of this machine, or in any `concurrent.futures.Executor`.

Dask goes through the same door: a `distributed.Client` lends an executor. Tasks are functions that a module names, and
their arguments pure values, so that both travel.
"""

import atexit
import hashlib
import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from functools import lru_cache
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from cpcal.common.errors import CpcalError, unusable
from cpcal.solver.execution import stopping
from cpcal.solver.execution.stopping import Reason, Stopped, asked, insisted

T = TypeVar("T")

Place = tuple[Executor, int]  # and how many tasks it is given at a time

PATIENCE = 10.0  # seconds that workers have to end by themselves
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_LOGGER = logging.getLogger("cpcal")
START = "forkserver" if sys.platform == "linux" else "spawn"  # safe beside threads
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
        self._threads = list[threading.Thread]()
        self._workers = list[_Worker]()
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
        if START == "forkserver":
            with suppress(OSError):  # whoever begins a process is told
                resource_tracker.ensure_running()  # before the next line, since it lets signals through
        if hasattr(signal, "pthread_sigmask"):  # which processes inherit that begin here: Ctrl-C is for this one
            signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        worker = None
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

    def _end(self, worker: "_Worker") -> None:
        self._workers.remove(worker)
        worker.end()


class _Worker:
    """A process that does tasks. A second pipe tells it to stop, and by its end that nobody is there any more."""

    _beginning = threading.Lock()  # multiprocessing begins one at a time

    def __init__(self, loads: Sequence[str]) -> None:
        """Raises OSError, EOFError, RuntimeError where none can be begun."""
        context = multiprocessing.get_context(START)
        self._tasks, tasks = context.Pipe()
        life, self._life = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(tasks, life))  # type: ignore[attr-defined]
        try:
            with self._beginning:
                if START == "forkserver":
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
        with suppress(OSError, TypeError):  # closed, or being closed by the thread that ends it: its handle is None
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
    threading.Thread(target=_listen, args=(life, stop), daemon=True).start()
    told = stopping.also_asked_by(lambda: Reason.INTERRUPTED if stop.is_set() else None)
    with suppress(EOFError, OSError), told:
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
        raise unusable("workers", "and another place to work are both given", remedy)
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
        raise unusable("scheduler", "a cluster needs dask.distributed", remedy) from None
    try:
        client = Client(address)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        remedy = "start `dask scheduler`, and give the address that it prints"
        what = f"no Dask scheduler answers there ({str(error)[:200]})"
        raise unusable(f"scheduler {address}", what, remedy) from None
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


# ------------------------------------------------------------------------------------------------------------------
# Many tasks through an executor: few at a time, in the order in which they are done, and none lost with its worker.
#
# A large value that many small tasks need is `Shared`: it travels to a worker once, not with every task.

A = TypeVar("A")
V = TypeVar("V")

DESERTED = 60.0  # seconds without a scheduler
_LOOK = 0.2  # seconds between looks at whether to stop
_TRIES = 3  # times that a task is begun whose worker ends
_KEPT = 4  # shared values that a worker keeps
_here: dict[str, Any] = {}  # those of this process, by digest
_KILLED = (
    "its process was killed, had no memory left, or could not begin (a script that begins workers does so after "
    "`if __name__ == '__main__':`)"
)
_GONE = "the scheduler is gone, or was started again too often"


class LostWorkerError(CpcalError):
    """Who did a task is gone: it was killed, had no memory left, or cannot be reached."""


def outcomes(
    executor: Executor, most: int, work: Callable[[A], T], tasks: Iterable[A]
) -> Iterator[tuple[A, Future[T]]]:
    """`work(task)` for all tasks, `most` of them given out at a time, in the order in which they are done: each with
    the future that has its value, or the exception that it raised.

    A task whose worker is killed, or whose scheduler begins anew, is begun again, three times at most, the last time
    alone, in case memory is short; then its exception is a LostWorkerError. When the process is asked to stop, no task
    is begun any more; those at work in processes of ours are told, and what they answer within ten seconds still comes.
    Raises LostWorkerError where nobody takes tasks any more.
    """
    pool, source = executor if isinstance(executor, Processes) else None, iter(tasks)
    again: deque[tuple[A, int]] = deque()
    finished: SimpleQueue[Future[T]] = SimpleQueue()  # in the order in which they are
    running = dict[Future[T], tuple[A, int]]()  # and how often it was begun
    stopped = None  # when
    reached = time.monotonic()  # a scheduler, last
    try:
        while True:
            while (
                len(running) < most and not asked() and not any(begun >= _TRIES for _, begun in running.values())
            ):  # one that lost its worker twice runs alone
                if again and again[0][1] + 1 >= _TRIES and running:
                    break
                try:
                    task, begun = again.popleft() if again else (next(source), 0)
                except StopIteration:
                    break
                try:
                    future = executor.submit(work, task)
                except (RuntimeError, ValueError, OSError) as error:  # of a client without scheduler, say
                    raise LostWorkerError(f"the executor takes no more tasks ({error})") from None
                running[future] = task, begun + 1
                future.add_done_callback(finished.put)
            if not running:
                return
            for future in _ended(finished):
                if future not in running:  # given up
                    continue
                task, begun = running.pop(future)
                cancelled = future.cancelled()  # by a Dask client that lost its scheduler, and looks for it again
                raised = None if cancelled else future.exception()
                lost = cancelled or isinstance(raised, BrokenExecutor)
                if isinstance(raised, Stopped) or (lost and asked()):
                    continue
                if lost and begun < _TRIES and (cancelled or pool is not None):
                    again.append((task, begun))
                    continue
                if lost:
                    future = Future()
                    future.set_exception(LostWorkerError(f"it was cancelled: {_GONE}" if cancelled else _KILLED))
                yield task, future
            if asked() and pool is None:  # what is at work elsewhere cannot be told: it is given up
                return
            if asked() and pool is not None and stopped is None:
                stopped = time.monotonic()
                pool.ask_to_stop()
                running = {future: given for future, given in running.items() if not future.cancel()}
            elif pool is not None and stopped is not None and (insisted() or time.monotonic() > stopped + PATIENCE):
                pool.kill()  # one that a SIGSTOP holds, say
            status = dask_status(executor)
            if status in (None, "running"):
                reached = time.monotonic()
            elif status in ("closing", "closed") or time.monotonic() > reached + DESERTED:
                running = {}
                what = f"did not answer for {int(DESERTED)} s, or the client is closed"
                raise LostWorkerError(f"the scheduler is gone: it {what}")
    finally:
        if asked() and running and pool is not None:
            pool.ask_to_stop()
        dask = dask_status(executor)
        if dask is None or (dask == "running" and asked()):  # else it complains of them: they end by themselves
            for future in running:
                future.cancel()


def _ended(finished: SimpleQueue[Future[T]]) -> Iterator[Future[T]]:
    with suppress(Empty):
        yield finished.get(timeout=_LOOK)
        while True:
            yield finished.get_nowait()


class Shared(Generic[V]):
    """A value, as bytes, for the workers of a place; nothing may change it."""

    def __init__(self, value: V, place: Place) -> None:
        self._place, self._bytes = place, pickle.dumps(value)
        self._digest = hashlib.sha256(self._bytes).hexdigest()

    def in_parts(self, work: Callable[..., Sequence[T]], items: Sequence[Any], *more: Any) -> list[T]:
        """`work(value, some, *more)` for as many parts of the items as may be at work: its answers in their order.

        The value goes where a worker asks for it. Raises what the work raises, and Stopped when the process is asked to
        stop.
        """
        executor, most = self._place
        size = -(-len(items) // most)
        parts = [items[k : k + size] for k in range(0, len(items), size)]
        found = dict[int, Sequence[T]]()
        content = None
        while len(found) < len(parts):
            left = [k for k in range(len(parts)) if k not in found]
            tasks = [(k, work, self._digest, content, parts[k], more) for k in left]
            for (k, *_), future in outcomes(executor, most, _done, tasks):
                answer = future.result()
                if answer is not None:
                    found[k] = answer
            reason = asked()
            if reason is not None and len(found) < len(parts):
                raise Stopped(reason)
            content = self._bytes
        return [one for k in range(len(parts)) for one in found[k]]


def _done(task: tuple[Any, ...]) -> Any:
    """None says that this worker has never seen the value: an error would be in a cluster's log."""
    _, work, digest, content, items, more = task
    if digest not in _here:
        if content is None:
            return None
        while len(_here) >= _KEPT:
            del _here[next(iter(_here))]
        _here[digest] = pickle.loads(content)
    with linear_algebra_on_one_thread():
        return work(_here[digest], items, *more)


# ------------------------------------------------------------------------------------------------------------------
# Linear algebra on one thread: its own threads would change the last bits of sums, and fight with other workers.
#
# The limit is the process's, not a thread's. So it is set when the first user of the process comes and taken away when
# the last one leaves: a task that ends must not set it free while others compute.

_SAID = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")


def while_used(begin: Callable[[ExitStack], object]) -> Callable[[], AbstractContextManager[None]]:
    """A state of the process that the first of its users begins, and that ends when the last of them leaves.

    `begin` enters what has to be undone into the stack that it is given.
    """
    lock, undone, users = threading.Lock(), ExitStack(), 0

    @contextmanager
    def used() -> Iterator[None]:
        nonlocal users
        with lock:
            if not users:
                begin(undone)
            users += 1
        try:
            yield
        finally:
            with lock:
                users -= 1
                if not users:
                    undone.close()

    return used


@lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    """Of linear algebra, in this process while so many modules are imported: looking for them takes a millisecond."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _limited(undone: ExitStack) -> None:
    undone.enter_context(_libraries(len(sys.modules)).limit(limits=1))
    for name in _SAID:  # libraries that are loaded meanwhile read here how many threads they may use, and stay with one
        if name not in os.environ:
            os.environ[name] = "1"
            undone.callback(os.environ.pop, name, None)


linear_algebra_on_one_thread = while_used(_limited)
"""One thread for each call of these libraries in this process, until the last of all users leaves."""
