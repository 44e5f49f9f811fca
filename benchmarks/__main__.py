"""`python -m benchmarks`."""

import signal

from benchmarks.commands import app

if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the process of a run is ended, too
    app(prog_name="python -m benchmarks")
