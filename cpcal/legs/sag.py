"""The leg model `sag`: a leg that its own weight bends, which brings its ends together.

    t = -c ((L + l0) / s)^7 sin^2(tilt)

is what is added to the length of a uniform slender beam on two hinges, with one parameter: c, by how much it would
shorten lying flat with its mid-range length s. Length and tilt are taken from the stated reading and the drawing's
joint centres, so that the correction is a number for each measurement times c: the reading's set and the drawing's
errors change it by parts in a thousand. The base is taken to be level: vertical is the normal of its joints' plane.
"""

from __future__ import annotations

from cpcal.calibration.diagnosis import mid_range, sag_shape
from cpcal.legs.models import LegModel, Measured, Parameter, Parameters
from cpcal.solver.network import Expr
from cpcal.solver.network.expression import as_expr


def _sag(measured: Measured, x: Parameters) -> Expr:
    drawn = measured.drawn
    middle = drawn.offset + float(mid_range(drawn.length))
    return -1.0 * (x["c"] * as_expr(sag_shape(drawn.vector, drawn.length + drawn.offset, middle, drawn.up)))


SAG = LegModel(
    "sag",
    "L + l - c (length / mid-range length)^7 sin(tilt)^2: the leg's weight bends it, c is what it loses lying flat",
    (Parameter("c", "mm", 10.0),),
    _sag,
)
