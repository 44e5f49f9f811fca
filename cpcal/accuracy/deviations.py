"""By how much the certified sets let each leg deviate from what the controller believes, over cells of poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpcal.accuracy.certified_set import SIZE, CertifiedSet
from cpcal.accuracy.pose_cells import Cells, LegVectors, leg_vectors_over
from cpcal.accuracy.vectors import ENGINE, along_turn, applied, cross, dot, joined, point, total, transposed
from cpcal.common.arrays import Floats
from cpcal.solver.interval import IntervalArray


def scales(cells: Cells, controller: Floats) -> Floats:
    """(K, n) mm: lengths of the controller's legs at the centers, in floating point; what makes deviations mm."""
    return leg_vectors_over(cells.centers, controller).length.mid


def center_deviations(cells: Cells, sets: Sequence[CertifiedSet], controller: Floats, scale: Floats) -> IntervalArray:
    """(K, n) mm: (||P + R b - a||^2 - (||v|| - l^ + l)^2) / (2 scale) over S for the centers P, R of the cells."""
    center = leg_vectors_over(cells.centers, controller)
    exact = _directions(center, scale)
    asked = exact.mid
    rounding = ENGINE.sub(exact, point(asked))
    found = [one.ranges(asked[:, k]) for k, one in enumerate(sets)]
    at_center = joined([r.reshape((len(cells), 1)) for r in found])
    boxes = joined([one.box[None] for one in sets], 0)
    return ENGINE.add(at_center, dot(rounding, boxes[None]))


def deviations_across(
    cells: Cells, sets: Sequence[CertifiedSet], controller: Floats, scale: Floats, at_center: IntervalArray
) -> IntervalArray:
    """The same for all poses of each cell: what they add to `at_center` is enclosed, without linear programs."""
    center = leg_vectors_over(cells.centers, controller)
    return ENGINE.add(at_center, _across(cells, sets, controller, scale, center))


def _directions(legs: LegVectors, scale: Floats) -> IntervalArray:
    """(K, n, 17): the linear form in z of each leg, divided by 2 scale."""
    count, n = scale.shape
    of_alpha, of_beta = ENGINE.neg(legs.vector), applied(transposed(legs.rotation), legs.vector)
    of_w = point(np.full((count, n, 1), 0.5))
    of_products = ENGINE.neg(legs.rotation.reshape((count, 1, 9)).broadcast_to((count, n, 9)))
    form = joined([of_alpha, of_beta, ENGINE.neg(legs.length[..., None]), of_w, of_products])
    assert form.shape == (count, n, SIZE)
    return ENGINE.div(form, point(scale[..., None]))


def _across(
    cells: Cells, sets: Sequence[CertifiedSet], controller: Floats, scale: Floats, center: LegVectors
) -> IntervalArray:
    """(K, n) mm: what the linear form adds between the center and the other poses of a cell, for all z of S.

    Of its first seven coefficients as a mean-value form in (p, s) for each direction of the sets' basis: a direction
    that the measurements leave open changes the length much the same at all poses. Of the products by their boxes.
    """
    legs = leg_vectors_over(cells, controller)
    basis = np.stack([one.basis for one in sets])  # (n, 7 components, 7 directions)
    along = joined([one.along[None] for one in sets], 0)
    boxes = joined([one.box[None] for one in sets], 0)
    slopes = _slopes(cells, legs, basis)
    per_direction = dot(slopes, cells.reach[:, None, None, :])  # (K, n, 7)
    linear = dot(per_direction, along[None])
    # z[:7] = basis @ (basis.T @ z) + (I - basis @ basis.T) z[:7]: rounding alone
    lost = ENGINE.sub(point(np.eye(7)[None]), _squared(basis))
    change = ENGINE.sub(_directions(legs, np.ones_like(scale)), _directions(center, np.ones_like(scale)))
    stray = dot(change[..., :7], applied(lost, boxes[:, :7])[None])
    by_products = dot(change[..., 8:], boxes[None, :, 8:])
    return ENGINE.div(ENGINE.add(ENGINE.add(linear, stray), by_products), point(scale))


def _slopes(cells: Cells, legs: LegVectors, basis: Floats) -> IntervalArray:
    """(K, n, 7, 6): gradient in (p, s) of v.(R tau_b - tau_a) - ||v|| tau_l for each direction tau, over the cells."""
    tau = np.swapaxes(basis, 1, 2)  # (n, 7 directions, 7 components)
    turned_b = applied(legs.rotation[:, :, None], point(tau[None, :, :, 3:6]))  # (K, n, 7, 3)
    unit = ENGINE.div(legs.vector, legs.length[..., None])[:, :, None]
    shift = ENGINE.sub(turned_b, point(tau[None, :, :, :3]))
    of_position = ENGINE.sub(shift, ENGINE.mul(unit, point(tau[None, :, :, 6:])))
    vector, arm = legs.vector[:, :, None], legs.arm[:, :, None]
    of_turn = ENGINE.add(cross(turned_b, vector), cross(arm, of_position))
    return joined([of_position, along_turn(cells.reach[:, None, None, 3:], of_turn)])


def _squared(basis: Floats) -> IntervalArray:
    """basis @ basis.T for each leg, (n, 7, 7)."""
    return total(ENGINE.mul(point(basis[:, :, None, :]), point(basis[:, None, :, :])))
