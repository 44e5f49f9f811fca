"""Compiled code: `@compiled` is numba where it is installed, and the same function as plain Python where it is not.

The machine code is kept in the package's `__pycache__`, else in the user's cache folder. It belongs to the text of a
function's file and of all files whose compiled functions that file imports: numba itself looks at one file only, and
would go on running the old arithmetic inside of a caller that did not change.

With NUMBA_DISABLE_JIT=1 nothing is compiled. Where numba is missing, or no folder can be written, everything works,
slower, and says so once.
"""

from __future__ import annotations

import hashlib
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import update_wrapper
from pathlib import Path
from threading import RLock
from types import FunctionType
from typing import Any, TypeVar

from cpcal.solver.compiled_once import compiled_once

QUIET = "CPCAL_QUIET"  # of the environment: set, compilation is not announced

F = TypeVar("F", bound=Callable[..., Any])

_stamps: dict[str, str] = {}  # of every module with compiled functions
_said: set[str] = set()
_making = RLock()


class Compiled:
    """A function that numba compiles when it is first called; until then numba, which takes half a second, waits.

    numba sees the functions that it calls as they are in their modules, themselves compiled.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._made: Callable[..., Any] | None = None
        _stamp(function)  # now, while the module's globals are what the function's file puts before it

    def __call__(self, *args: Any) -> Any:
        return (self._made or self.made)(*args)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    @property
    def made(self) -> Callable[..., Any]:
        """The dispatcher; the plain function where numba is missing."""
        with _making:
            if self._made is None:
                self._made, scope = _made(self.py_func)
                for name in self.py_func.__code__.co_names:  # after it is made: it may call itself
                    if isinstance(scope.get(name), Compiled):
                        scope[name] = scope[name].made
        return self._made


def compiled(function: F) -> F:
    """The function, compiled when it is first called. It takes numbers and arrays and calls compiled functions only.

    Outside of its arithmetic it behaves as in Python, except that division by zero gives infinities and NaN as in
    numpy (plain Python calls it with numpy's numbers), and that it runs without the interpreter's lock.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return function
    return Compiled(function)  # type: ignore[return-value]


def ready(function: Callable[..., Any]) -> Callable[..., Any]:
    """What a compiled function calls: the dispatcher; the function itself where nothing is compiled."""
    return function.made if isinstance(function, Compiled) else function


def _made(function: Callable[..., Any]) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The dispatcher, and the globals that its function sees."""
    try:
        import numba
    except ImportError:
        _say_once("numba is not installed: cpcal runs its kernels in plain Python, hundreds of times slower")
        return function, {}
    scope = dict(function.__globals__)
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, function.__closure__)
    dispatcher = numba.njit(nogil=True, error_model="numpy")(update_wrapper(copy, function))
    _keep(dispatcher, function)
    return dispatcher, scope


def plain(function: F) -> F:
    """What was compiled, as plain Python."""
    return getattr(function, "py_func", function)


def rebound(functions: Iterable[Callable[..., Any]], primitives: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
    """Compiled functions (each after those that it calls) as plain Python that calls other primitives, by name.

    So one source computes in more than one arithmetic.
    """
    known: dict[str, Any] = dict(primitives)
    for function in map(plain, functions):
        if function.__name__ not in primitives:
            names = {**function.__globals__, **known}
            known[function.__name__] = FunctionType(function.__code__, names, function.__name__)
    return known


def _keep(dispatcher: Any, function: Callable[..., Any]) -> None:
    """Let numba keep the machine code in a folder of ours, under a stamp of ours."""
    from numba.core import caching

    _announce_compilation()
    folder, stamp = _folder(Path(function.__code__.co_filename).parent), _stamp(function)
    if folder is None:
        _say_once("no cache folder can be written: cpcal compiles its kernels anew in every process (XDG_CACHE_HOME)")
        return

    class Locator(caching._CacheLocator):  # type: ignore[misc]
        def get_cache_path(self) -> str:
            return str(folder)

        def get_source_stamp(self) -> str:
            return stamp

        def get_disambiguator(self) -> str:
            return str(function.__code__.co_firstlineno)

        @classmethod
        def from_function(cls, *_: Any) -> Any:
            return cls()

    class Impl(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = Impl

    dispatcher._cache = Cache(function)
    compiled_once(dispatcher, folder / f"{function.__module__.rpartition('.')[2]}.lock", _tell)


def _stamp(function: Callable[..., Any]) -> str:
    """A digest of a function's file, of the numbers that it imports, and of the files that it imports kernels from."""
    module = function.__module__
    if module not in _stamps:
        known = function.__globals__
        below = {_stamps.get(v.py_func.__module__, "") for v in known.values() if hasattr(v, "py_func")}
        numbers = sorted((k, repr(v)) for k, v in known.items() if isinstance(v, (int, float, tuple)))
        digest = hashlib.sha256(Path(function.__code__.co_filename).read_bytes())
        digest.update(repr((sorted(below), numbers)).encode())
        _stamps[module] = digest.hexdigest()
    return _stamps[module]


def _folder(source: Path) -> Path | None:
    """Where machine code of a source folder goes: beside Python's own, else into the user's cache; None for nowhere."""
    mark = hashlib.sha256(str(source).encode()).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    for folder in (source / "__pycache__", Path(home) / "cpcal" / mark):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK | os.X_OK):
            return folder
    return None


def _say_once(sentence: str) -> None:
    if sentence not in _said:
        _said.add(sentence)
        warnings.warn(sentence, RuntimeWarning, stacklevel=4)


def _announce_compilation() -> None:
    """Tell on stderr what is being compiled: it takes seconds, once, and must not look like a program that hangs.

    Nothing is told where the environment has CPCAL_QUIET: processes inherit it, so that the workers of a quiet run are
    quiet too.
    """
    from numba.core import event

    if "announce" in _said:
        return
    _said.add("announce")

    class Announcer(event.Listener):  # type: ignore[misc]
        depth = 0

        def on_start(self, happening: Any) -> None:
            if self.depth == 0 and _ours(happening) and QUIET not in os.environ:
                name = happening.data["dispatcher"].py_func.__name__.strip("_").replace("_", " ")
                print(f"cpcal: compiling '{name}', once ...", end="", file=sys.stderr, flush=True)
            self.depth += 1

        def on_end(self, happening: Any) -> None:
            self.depth -= 1
            if self.depth == 0 and _ours(happening) and QUIET not in os.environ:
                print(" done", file=sys.stderr, flush=True)

    event.register("numba:compile", Announcer())


def _tell(sentence: str) -> None:
    if QUIET not in os.environ:
        print(f"cpcal: {sentence}", file=sys.stderr, flush=True)


def _ours(happening: Any) -> bool:
    return bool(happening.data["dispatcher"].py_func.__module__ in _stamps)
