"""Contractors that come with cpcal; found by it through the entry points `cpcal.contractors`."""

from contractors.hc4 import HC4
from contractors.krawczyk import Beaumont, Krawczyk
from contractors.lifted import Lifted
from contractors.newton import Newton
from contractors.qinter import QInter, qinter
from contractors.shaving import Cid

__all__ = ["HC4", "Beaumont", "Cid", "Krawczyk", "Lifted", "Newton", "QInter", "qinter"]
