"""Placeholder until the shared decorator lands."""
from numba import njit
compiled = njit(cache=True, nogil=True)
