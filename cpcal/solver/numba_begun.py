"""Importing this makes numba ready for its first function, which takes half a second: once for all workers."""

from contextlib import suppress

with suppress(ImportError, AttributeError):  # where numba is missing, or has another inside: the first call does it
    from numba.core.registry import cpu_target

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
