"""Constraints that must hold for all values of parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.dag import leaves, topological
from cpcal.solver.network.expression import Constraint, Expr, as_expr


def for_all(constraint: Constraint, parameters: Mapping[bytes, Expr]) -> list[Constraint]:
    """The constraint itself, whose proofs hold for every value; and it with the ends and the middle of each parameter.

    What excludes a box must be wrong for one value only: so the others are needed. Raises ModelError for an equation.
    """
    parts = (constraint.body, constraint.lower, constraint.upper)
    own = [leaf for leaf in leaves(parts) if leaf.digest in parameters]
    if not own:
        return [constraint]
    if constraint.lower.digest == constraint.upper.digest:
        raise ModelError("an equation does not hold for all values of a parameter: give an inequality")
    out = [constraint]
    for pick in ("lo", "mid", "hi"):
        chosen = {leaf.digest: as_expr(IntervalArray.point(np.array(getattr(leaf.data, pick)))) for leaf in own}
        out.append(Constraint(*(replaced(part, chosen) for part in parts)))
    return out


def replaced(root: Expr, leaves_by: Mapping[bytes, Expr]) -> Expr:
    """The expression with some of its leaves replaced."""
    done: dict[bytes, Expr] = {}
    for node in topological((root,)):
        if node.digest in leaves_by:
            done[node.digest] = leaves_by[node.digest]
        elif any(done[arg.digest] is not arg for arg in node.args):
            args = tuple(done[arg.digest] for arg in node.args)
            done[node.digest] = Expr(node.op, args, node.shape, node.parameter, node.name, node.data, node.owner)
        else:
            done[node.digest] = node
    return done[root.digest]
