"""Contractors that come with cpcal; found by it through the entry points `cpcal.contractors`."""

from contractors.algebra import Composable, Fixpoint, Then, Union, fixpoint
from contractors.box_consistency import BoxConsistency
from contractors.cid import Cid
from contractors.hc4 import HC4
from contractors.lifted import Lifted
from contractors.newton import Newton
from contractors.qinter import QInter, qinter
from contractors.separators import Separator, Violating
from contractors.shaving import Shaving
from contractors.violation import MostViolated

__all__ = [
    "HC4",
    "BoxConsistency",
    "Cid",
    "Composable",
    "Fixpoint",
    "Lifted",
    "MostViolated",
    "Newton",
    "QInter",
    "Separator",
    "Shaving",
    "Then",
    "Union",
    "Violating",
    "fixpoint",
    "qinter",
]
