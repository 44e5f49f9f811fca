"""Contractors that come with cpcal; found by it through the entry points `cpcal.contractors`."""

from contractors.algebra import Composable, Fixpoint, Then, Union, fixpoint
from contractors.beaumont import Beaumont
from contractors.hc4 import HC4
from contractors.krawczyk import Krawczyk
from contractors.lifted import Lifted
from contractors.linear_system import LinearSystem

__all__ = [
    "HC4",
    "Beaumont",
    "Composable",
    "Fixpoint",
    "Krawczyk",
    "Lifted",
    "LinearSystem",
    "Then",
    "Union",
    "fixpoint",
]
