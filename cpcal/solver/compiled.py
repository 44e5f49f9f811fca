"""Compiled code: `@compiled` is numba where it is installed, and the same function as plain Python where it is not.

The machine code is kept in the package's `__pycache__`, else in the user's cache folder. It belongs to the text of a
function's file and of all files whose compiled functions that file imports: numba itself looks at one file only, and
would go on running the old arithmetic inside of a caller that did not change. A file of machine code begins with a
digest of all that; one that is cut, overwritten or outdated is compiled again, and replaced.

Only what Python calls becomes machine code, together with all that it calls. A function that compiled functions call
is analysed once and linked into each of them: numba by itself would make it callable from Python, optimise it and emit
its code each time, which took 15 of 36 seconds that the kernels of a leg need.

One process compiles a function, the others wait for what it keeps. The lock is a file beside the machine code, one for
each source file, taken where no machine code was found; the system takes it back when a process ends. None waits
longer than `LONGEST`, but compiles itself. The first process that compiles has another one begin with what takes the
longest, its `ahead` calls, so that two processors work.

With NUMBA_DISABLE_JIT=1 nothing is compiled. Where numba is missing, or no folder can be written, everything works,
slower, and says so once.
"""

import hashlib
import math
import os
import pickle
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import cache, update_wrapper
from pathlib import Path
from threading import RLock
from types import FunctionType, ModuleType
from typing import Any, TypeAlias, TypeVar

from cpcal.common.files import exclusive

QUIET = "CPCAL_QUIET"  # of the environment: set, compilation is not announced
LONGEST = 120.0  # seconds to wait for another process
_PAUSE = 0.05

Function: TypeAlias = Callable[..., Any]
F = TypeVar("F", bound=Function)

_stamps = dict[str, str]()  # of every module with compiled functions
_ahead: list[Callable[[], object]] = []
_compiling = 0  # kernels that this process has compiled
_making = RLock()
_deadline: ContextVar[float] = ContextVar("deadline", default=math.inf)


class TimeUp(KeyboardInterrupt):
    """The time limit came before a function was compiled. As Ctrl-C does, it ends a search with what is proved."""


@contextmanager
def compiling_until(deadline: float) -> Iterator[None]:
    """While in the block no compilation begins, and none is waited for, after `deadline` (of time.monotonic()): TimeUp.

    One that has begun goes on to its end: some seconds for a function and what it calls.
    """
    before = _deadline.set(min(deadline, _deadline.get()))
    try:
        yield
    finally:
        _deadline.reset(before)


class Compiled:
    """A function that numba compiles when it is first called; until then numba, which takes half a second, waits.

    numba sees the functions that it calls as they are in their modules, themselves compiled.
    """

    def __init__(self, function: Function) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._made = dict[bool, Function]()  # for Python, and for compiled functions
        _stamp(function)  # now, while the module's globals are what the function's file puts before it

    def __call__(self, *args: Any) -> Any:
        return (self._made.get(False) or self.made(False))(*args)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    def made(self, linked: bool) -> Function:
        """The dispatcher, one for Python and one to be `linked`; the plain function where numba is missing."""
        with _making:
            if linked not in self._made:
                self._made[linked], link = _made(self.py_func, linked)
                if linked:
                    link()  # after it is made: it may call itself
        return self._made[linked]


def compiled(function: F) -> F:
    """The function, compiled when it is first called. It takes numbers and arrays and calls compiled functions only.

    Outside of its arithmetic it behaves as in Python, except that division by zero gives infinities and NaN as in
    numpy (plain Python calls it with numpy's numbers), and that it runs without the interpreter's lock.
    """
    vars(function)["kernel"] = True
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return function
    return Compiled(function)  # type: ignore[return-value]


def _made(function: Function, linked: bool) -> tuple[Function, Callable[[], None]]:
    """The dispatcher, and what links the compiled functions that it calls, which only a compilation needs."""
    try:
        import numba
    except ImportError:
        _say_once("numba is not installed: cpcal runs its kernels in plain Python, hundreds of times slower")
        return function, lambda: None
    scope = dict(function.__globals__)
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, function.__closure__)
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": linked}
    dispatcher = numba.njit(**options)(update_wrapper(copy, function))

    def link() -> None:
        for name in function.__code__.co_names:
            if isinstance(scope.get(name), Compiled):
                scope[name] = scope[name].made(True)

    if not linked:
        _keep(dispatcher, function, link)
    return dispatcher, link


def ahead(call: F) -> F:
    """A call without arguments, at the top of a module, of kernels that take long to compile."""
    _ahead.append(call)
    return call


@cache
def _begin_ahead() -> Any:
    """The process that makes the calls of the modules loaded now, if there is one. It ends with this one."""
    import atexit
    import multiprocessing
    import subprocess

    if not _ahead or not sys.executable or (os.cpu_count() or 1) < 2 or multiprocessing.parent_process() is not None:
        return None
    script = [
        f"import sys; sys.path[:] = {sys.path!r}",
        "from cpcal.solver import compiled; compiled._begin_ahead = lambda: None",
        *(f"from {call.__module__} import {call.__name__} as call; call()" for call in _ahead),
    ]
    command, nothing = [sys.executable, "-c", "\n".join(script)], subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
    except OSError:
        return None

    def end() -> None:
        process.kill()
        process.wait()

    atexit.register(end)
    return process


def plain(function: F) -> F:
    """What was compiled, as plain Python."""
    return getattr(function, "py_func", function)


def in_python(module: ModuleType) -> dict[str, Any]:
    """The compiled functions of a module, by name, as plain Python that calls plain Python."""
    found = {name: plain(f) for name, f in vars(module).items() if getattr(f, "kernel", False)}
    scope = dict(vars(module))
    scope |= {name: FunctionType(function.__code__, scope, name) for name, function in found.items()}
    return scope


def _keep(dispatcher: Any, function: Function, link: Callable[[], None]) -> None:
    """Let numba keep the machine code in a folder of ours, under a stamp of ours."""
    from numba.core.compiler_lock import global_compiler_lock

    cache, compile_it = _machine_code(function, link), dispatcher.compile

    def compile_in_turn(signature: Any) -> Any:
        # numba's own lock first: a thread that has the file's must not wait for one that waits for the file
        with global_compiler_lock, cache.turn:
            return compile_it(signature)

    dispatcher._cache, dispatcher.compile = cache, compile_in_turn


@contextmanager
def _linking(outermost: str, context: Any) -> Iterator[None]:
    """While in the block only the library of this name becomes machine code; the others are to be linked into it."""
    from numba import _dynfunc
    from numba.core.codegen import JITCodeLibrary

    class Linked(JITCodeLibrary):  # type: ignore[misc]
        def _optimize_final_module(self) -> None: ...

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._verify_declare_only_symbols()
            self._finalized = True

    def create_library(name: str, **options: Any) -> Any:
        return (JITCodeLibrary if name == outermost else Linked)(codegen, name, **options)

    def get_executable(library: Any, description: Any, environment: Any) -> Any:
        if isinstance(library, Linked):
            ours = description.llvm_cpython_wrapper_name not in {f.name for f in library.get_defined_functions()}
            if ours or description.modname.startswith("numba."):
                # numba looks a function up by an object of this type; nobody calls it
                return _dynfunc.make_function(description.lookup_module(), description.qualname, "", 0, environment, ())
            JITCodeLibrary._optimize_final_module(library)  # a dispatcher of someone else's, which Python may call
            JITCodeLibrary._finalize_final_module(library)
        return executable(library, description, environment)

    codegen, executable = context.codegen(), context.get_executable
    codegen.create_library, context.get_executable = create_library, get_executable
    try:
        yield
    finally:
        del codegen.create_library, context.get_executable


@cache
def _short_errors() -> None:
    """Let arrays of another shape raise an error without a text: the one that numba writes takes seconds to compile."""
    from numba.extending import overload
    from numba.np import arrayobj

    def raised(source: Any, target: Any) -> None: ...

    @overload(raised)  # type: ignore[untyped-decorator]
    def overloaded(source: Any, target: Any) -> Callable[..., None]:
        def raise_it(source: Any, target: Any) -> None:
            raise ValueError("shapes differ")

        return raise_it

    arrayobj.raise_with_shape_context = raised


def _machine_code(function: Function, link: Callable[[], None]) -> Any:
    """What numba asks for the machine code of a function, and gives it to: one file for each signature."""
    import numba
    from numba.core import caching, compiler, serialize
    from numba.core.runtime.nrt import rtsys

    folder = _folder(Path(function.__code__.co_filename).parent)
    module = function.__module__.rpartition(".")[2]
    stamp = hashlib.sha256(repr((_stamp(function), numba.__version__, sys.version)).encode())

    class MachineCode(caching._Cache):  # type: ignore[misc]
        def __init__(self) -> None:
            self.turn = ExitStack()  # what a compilation holds: the lock, the line that tells of it, how it links

        @property
        def cache_path(self) -> str:
            return str(folder)

        def load_overload(self, signature: Any, context: Any) -> Any:
            """What is kept, or None, and then it is this process's turn to compile. Raises TimeUp."""
            rtsys.initialize(
                context
            )  # all of the context that what was compiled needs: the rest takes a third of a second
            file = self._file(signature, context.codegen())
            found = self._read(file, context)
            if found is None:
                _begin_ahead()
                self.turn.enter_context(_turn(folder / f"{module}.lock", function.__name__))
                found = self._read(file, context)  # another process may have made it meanwhile
            if found is None and time.monotonic() > _deadline.get():
                late = f"the time limit came before '{function.__name__}' was compiled"
                _tell(f"cpcal: {late}")
                raise TimeUp(late)
            if found is None:
                self.turn.enter_context(_announced(function.__name__))
                self.turn.enter_context(_linking(function.__qualname__, context))
                _short_errors()
                link()
            return found

        def save_overload(self, signature: Any, made: Any) -> None:
            if made.lifted or made.library.has_dynamic_globals:
                return  # it belongs to this process alone
            (name, kind, (machine_code, _)), *parts, environments = made._reduce()
            library = name, kind, (machine_code, _name_alone(made.fndesc.llvm_cpython_wrapper_name))
            # of what is linked in, an environment without objects serves nobody, and costs the import of its module
            content = serialize.dumps((library, *parts, tuple(one for one in environments if one.consts)))
            file = self._file(signature, made.codegen)
            draft = file.with_name(f"{file.name}.{os.urandom(8).hex()}.draft")
            try:
                draft.write_bytes(self._digest(content) + content)
                draft.replace(file)
            except OSError as error:
                with suppress(OSError):
                    draft.unlink()
                why = f"machine code cannot be kept in {folder} ({error.strerror or error})"
                _say_once(f"{why}: cpcal compiles its kernels anew in every process (XDG_CACHE_HOME)")

        def enable(self) -> None: ...

        disable = flush = enable

        def _file(self, signature: Any, codegen: Any) -> Path:
            """For this function, its arguments, this processor and this Python."""
            of = (function.__qualname__, signature, codegen.magic_tuple(), sys.implementation.cache_tag)
            mark = hashlib.sha256(repr(of).encode()).hexdigest()[:16]
            return folder / f"{module}.{function.__name__}-{mark}.kernel"

        @staticmethod
        def _digest(content: bytes) -> bytes:
            """Of the machine code and all that it was made of."""
            of = stamp.copy()
            of.update(content)
            return of.digest()

        def _read(self, file: Path, context: Any) -> Any:
            try:
                content = file.read_bytes()
                size = stamp.digest_size
                if content[:size] == self._digest(content[size:]):
                    return compiler.CompileResult._rebuild(context, *pickle.loads(content[size:]))
            except Exception:  # whatever keeps it from being loaded: it is compiled again
                pass
            return None

    return MachineCode()


def _name_alone(function: str) -> Any:
    """What numba reads beside the machine code: the name that it looks up. With all names loading takes a half more,
    with the code in LLVM's form, which serves those alone who link what is kept into something else, thrice as long."""
    from numba.core.codegen import ll

    return ll.parse_assembly(f'define void @"{function}"() {{ unreachable }}').as_bitcode()


@contextmanager
def _turn(lock: Path, name: str) -> Iterator[None]:
    """While in the block no other process compiles what is under this lock; it is waited for, but not for too long."""
    descriptor, began, told = None, time.monotonic(), False
    with suppress(OSError):  # where nothing can be locked every process compiles
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        while time.monotonic() < min(began + LONGEST, _deadline.get()):
            try:
                exclusive(descriptor)
            except BlockingIOError:
                if not told and time.monotonic() > began + 0.5 and _begin_ahead() is None:
                    _tell(f"cpcal: waiting for another process that compiles '{name}'")
                    told = True
                time.sleep(_PAUSE)
            else:
                break
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _stamp(function: Function) -> str:
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


def _folder(source: Path) -> Path:
    """Where machine code of a source folder goes: beside Python's own, else into the user's cache."""
    mark = hashlib.sha256(str(source).encode()).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    for folder in (source / "__pycache__", Path(home) / "cpcal" / mark):
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                break
    return folder


@contextmanager
def _announced(name: str) -> Iterator[None]:
    """While in the block a terminal shows what is compiled; elsewhere one line tells it for all of a process."""
    global _compiling
    _compiling += 1
    shown = sys.stderr.isatty()
    if shown:
        _tell(f"\rcpcal: compiling, once: kernel {_compiling}, '{name.strip('_').replace('_', ' ')}' ...\x1b[K", end="")
    elif _compiling == 1:
        _tell("cpcal: compiling its kernels, once; each takes a few seconds")
    try:
        yield
    finally:
        if shown:
            _tell("\r\x1b[K", end="")


@cache
def _say_once(sentence: str) -> None:
    warnings.warn(sentence, RuntimeWarning, stacklevel=4)


def _tell(sentence: str, end: str = "\n") -> None:
    """On stderr: what takes seconds must not look like a program that hangs.

    Nothing is told where the environment has CPCAL_QUIET: processes inherit it, so that the workers of a quiet run are
    quiet too.
    """
    if QUIET not in os.environ:
        print(sentence, end=end, file=sys.stderr, flush=True)
