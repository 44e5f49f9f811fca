"""newton: the interval Newton operator on a square part of a network's equalities (see `solver.existence.operators`).

Near a simple zero the widths of a box are squared at every pass. To prove that a zero exists is the matter of
`cpcal.solver.existence.prove_unique`, which `Network.solve` asks about each box that it keeps.
"""

from __future__ import annotations

import numpy as np

from contractors.hc4 import moved_bounds
from cpcal.solver.contract import Composable, Contraction, Step, repeated
from cpcal.solver.existence import Equalities, Operator, chosen, hansen_sengupta, unknowns
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork


class Newton(Composable):
    """Repeats the operator (`hansen_sengupta` or `krawczyk`) while it halves some width. Bounded boxes only.

    With more equations than unknowns the best conditioned ones are taken; with fewer, some components stay as they
    are and count as parameters. Inequalities are ignored.
    """

    monotone_tolerance = np.inf  # rows, columns and the inverse are chosen anew on every box

    def __init__(
        self,
        network: ConstraintNetwork,
        *,
        objective: str | None = None,
        arithmetic: str = "float64",
        operator: Operator = hansen_sengupta,
        most: int = 10,
    ) -> None:
        self._engine = get_arithmetic(arithmetic)
        self._operator, self._most = operator, most
        self._equalities = Equalities(network)

    def contract(self, box: Box) -> Contraction:
        after = repeated(self._pass, box, ratio=0.5, most=self._most).box
        if after.is_empty and not box.is_empty:
            return Contraction(after, (Step("newton", None, "", np.nan),))
        return Contraction(after, moved_bounds("newton", box, after))

    def _pass(self, box: Box) -> Contraction:
        return Contraction(self._image(box))

    def _image(self, box: Box) -> Box:
        if box.is_empty or not box.is_bounded or not self._equalities.count:
            return box
        linear = self._equalities.linearize(self._engine, box, box.mid)
        square = None if linear is None else unknowns(linear, box.array)
        if linear is None or square is None:
            return box
        rows, columns = square
        with np.errstate(all="ignore"):
            image = self._operator(self._engine, chosen(linear, rows), columns, box.array)
        return box if image is None else box.intersect(box.with_bounds(image.lo, image.hi))
