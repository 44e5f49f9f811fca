"""`python -m cpcal.checker RUN`, or the folder itself: `python -I -S checker RUN`. The standard library is enough."""

from __future__ import annotations

import gc
import importlib.util
import sys
from pathlib import Path

if not __package__:  # the folder was run, wherever it was copied: what lies beside it is none of our business
    folder = Path(__file__).resolve().parent
    del sys.path[0]
    spec = importlib.util.spec_from_file_location("checker", folder / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    sys.modules["checker"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["checker"])
    __package__ = "checker"

from .command import main

gc.set_threshold(50_000)  # numbers are no garbage: to look through them takes time
sys.exit(main(sys.argv[1:]))
