"""`cpcal` and `python -m cpcal`: imports nothing before signals are taken care of."""


def main() -> None:
    """Entry point of the command `cpcal`."""
    import gc
    import sys

    gc.set_threshold(200_000)  # modules and numbers are no garbage: to look through them takes a tenth of the time
    _leave_at_once_while_starting()
    _refuse_where_libraries_have_no_room()
    try:
        from cpcal.cli.app import app

        app(prog_name="cpcal")
    except KeyboardInterrupt:
        sys.stderr.write("cpcal: interrupted\n")
        sys.exit(130)
    except Exception as error:
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        sys.stderr.write(f"cpcal: internal error, please report it with the command and its files ({what})\n")
        sys.exit(3)
    finally:
        gc.freeze()  # to look through all modules once more, when Python ends, takes up to a tenth of a second
        # After a Ctrl-C within an exec (of dataclasses, say) Python ends by SIGINT, whatever the status: a new exec
        # makes it forget.
        exec("")


def _leave_at_once_while_starting() -> None:
    """A signal ends the process with one sentence, whatever is being imported, where no exception would be safe.

    Verbs that have something to tidy up, or to answer, listen by themselves while they run.
    """
    import signal

    from cpcal.solver.execution.stopping import leave_at_once

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, leave_at_once)


def _refuse_where_libraries_have_no_room() -> None:
    """Under a limit of address space (`ulimit -v`) linear algebra is loaded now, or nothing is.

    OpenBLAS asks for a buffer of each thread when it is loaded, and goes on asking for ever where it gets none; no
    signal handler of Python runs meanwhile.
    """
    import os
    import sys

    try:
        import resource  # of POSIX only
    except ImportError:
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return
    needed = 2**29 + (os.cpu_count() or 1) * 2**26  # numpy's and scipy's buffers: 32 MiB each
    if limit < needed:
        what = f"limited to {int(limit / 1e6)} MB (ulimit -v), and libraries need {int(needed / 1e6)} MB"
        sys.stderr.write(f"cpcal: too little memory: the address space is {what}\n")
        sys.exit(2)
    import scipy.linalg  # noqa: F401


if __name__ == "__main__":
    main()
