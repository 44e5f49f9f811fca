"""beaumont: the krawczyk contractor with the inequalities of Beaumont's decomposition added (paper, 4.3.2).

Oettli and Prager: the solutions z of `A z <= -v` for some A in an interval matrix are those of the real inequality
`(mid A) z - (rad A) |z| <= -v`, linear wherever no z_j changes its sign. Beaumont replaces each |z_j| by its chord
over the box. About the midpoint of the box that is Krawczyk's row again; so the same interval-linear system is
expanded at other points too, where z has one sign and nothing is lost:

- rows that are not affine in x at two opposite corners of the box;
- affine rows, `A(M) x <= b(M)`, at x = 0, where no reading counts twice: the interval linear system itself.
"""

from __future__ import annotations

import numpy as np

from contractors.interval_rows import Decomposition, IntervalRows, beaumont
from contractors.krawczyk import Krawczyk
from cpcal.solver.interval import Box

_THIN = 1e-9  # of the largest coefficient: rows whose matrix is no wider gain nothing by another expansion


class Beaumont(Krawczyk):
    """As Krawczyk, with three to four times the rows and a tighter polyhedron where boxes are wide."""

    name = "beaumont"

    def _rows(self, box: Box) -> list[tuple[IntervalRows, Decomposition]]:
        corners = self._system.at(box, [box.lo, box.hi], affine=False)
        origin = self._system.at(box, [np.zeros(len(box))], affine=True)
        return super()._rows(box) + [(_thick(rows), beaumont) for rows in corners + origin]


def _thick(rows: IntervalRows) -> IntervalRows:
    radius, size = rows.matrix.rad.max(axis=1, initial=0.0), rows.matrix.mag.max(axis=1, initial=0.0)
    return rows[radius > _THIN * size]
