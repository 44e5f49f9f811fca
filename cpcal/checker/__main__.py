"""`python -m cpcal.checker RUN`, or the folder itself: `python -I -S checker RUN`. The standard library is enough."""

from __future__ import annotations

import sys
from pathlib import Path

if not __package__:  # the folder was run, wherever it was copied
    folder = Path(__file__).resolve().parent
    sys.path[0] = str(folder.parent)
    __package__ = folder.name
    __import__(__package__)

from .command import main

sys.exit(main(sys.argv[1:]))
