"""Contractors that come with cpcal; found by it through the entry points `cpcal.contractors`."""

from contractors.algebra import Composable, Fixpoint, Then, Union, fixpoint
from contractors.hc4 import HC4
from contractors.lifted import Lifted

__all__ = ["HC4", "Composable", "Fixpoint", "Lifted", "Then", "Union", "fixpoint"]
