"""`cpcal` and `python -m cpcal`: imports nothing before signals are taken care of."""


def main() -> None:
    """Entry point of the command `cpcal`."""
    import gc
    import sys

    gc.set_threshold(50_000)  # modules and numbers are no garbage: to look through them takes a tenth of the time
    _leave_at_once_while_starting()
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
        # After a Ctrl-C within an exec (of dataclasses, say) Python ends by SIGINT, whatever the status: a new exec
        # makes it forget.
        exec("")


def _leave_at_once_while_starting() -> None:
    """A signal ends the process with one sentence, whatever is being imported, where no exception would be safe.

    Verbs that have something to tidy up, or to answer, listen by themselves while they run.
    """
    import signal

    from cpcal.execution.stopping import leave_at_once

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, leave_at_once)


if __name__ == "__main__":
    main()
