"""A network, and what is to be minimised, as Minibex text that `read_minibex` and ibex read.

Every element of an array is written out. Numbers are the shortest decimals that read back as the same float64; numbers
that no float64 equals are written as the interval around them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.problems.values import array_of
from cpcal.solver.interval import Box
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr
from cpcal.solver.network.expression import folded, topological

Texts = npt.NDArray[np.object_]

_FORMS = {"add": "({}+{})", "sub": "({}-{})", "mul": "({}*{})", "div": "({}/{})", "neg": "(-{})", "log": "ln({})"}
_FORMS |= {"sqr": "({}^2)"}
_CALLED = ("sqrt", "abs", "exp", "sin", "cos", "tan", "asin", "atan")
_FORMS |= {name: name + "({})" for name in _CALLED}
_FORMS |= {name: name + "({},{})" for name in ("min", "max", "atan2")}
_LONGEST = 10_000_000  # characters


def minibex_text(network: ConstraintNetwork, objective: Expr | None = None) -> str:
    """The problem. Raises ModelError for arrays of three axes, and for a reading used twice."""
    writer = _MinibexWriter(network)
    lines = ["Variables"]
    lines += [f"  {writer.declared(leaf)};" for leaf in network.variables]
    if objective is not None:
        lines += ["Minimize", f"  {writer.of(objective).item()};"]
    lines.append("Constraints")
    lines += [f"  {row};" for constraint in network.constraints for row in writer.rows(constraint)]
    return "\n".join([*lines, "end", ""])


class _MinibexWriter:
    """Texts of all elements of each expression, once."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._network, self._domain, self._done = network, network.domain, dict[bytes, Texts]()
        self._size = 0
        for leaf in network.variables:
            if len(leaf.shape) > 2:
                raise ModelError(f"{leaf.name!r} has {len(leaf.shape)} axes: Minibex has vectors and matrices")
            places = [",".join(str(k + 1) for k in index) for index in np.ndindex(leaf.shape)]
            self._done[leaf.digest] = array_of([f"{leaf.name}({p})" if p else leaf.name for p in places], leaf.shape)

    def declared(self, leaf: Expr) -> str:
        """A variable with its dimensions and its domain."""
        box: Box = self._domain
        names = [name for name in box.names if self._network.leaf_of(name) is leaf]
        bounds = [_interval(box[name].lo, box[name].hi) for name in names]
        sides = "".join(f"[{side}]" for side in leaf.shape)
        if not leaf.shape:
            return f"{leaf.name} in {bounds[0]}"
        if len(set(bounds)) == 1:
            return f"{leaf.name}{sides} in {bounds[0]}"
        width = leaf.shape[-1] if len(leaf.shape) == 2 else 1
        rows = [bounds[k : k + width] for k in range(0, len(bounds), width)]
        said = ";".join(f"({','.join(row)})" if width > 1 else row[0] for row in rows)
        return f"{leaf.name}{sides} in ({said})"

    def rows(self, constraint: Constraint) -> list[str]:
        """The elements of a constraint; bounds that say nothing are left out."""
        body, shape = self.of(constraint.body), constraint.body.shape
        lower, upper = (np.broadcast_to(self.of(b), shape).ravel() for b in (constraint.lower, constraint.upper))
        same = constraint.is_equation
        out = []
        for text, low, high in zip(body.ravel(), lower, upper, strict=True):
            if same or low == high:
                out.append(f"{text} = {low}")
                continue
            out += [f"{text} >= {low}"] if low != "(-oo)" else []
            out += [f"{text} <= {high}"] if high != "oo" else []
        return out

    def of(self, root: Expr) -> Texts:
        def written(node: Expr, args: list[Texts]) -> Texts:
            texts = self._node(node, args)
            self._size += sum(map(len, texts.ravel()))
            if self._size > _LONGEST:
                raise ModelError("the problem is too long written out: give common parts as variables")
            return texts

        return folded(root, written, self._done)

    def _node(self, node: Expr, args: list[Texts]) -> Texts:
        if not node.args:
            return self._leaf(node)
        if node.op == "index":
            return np.asarray(args[0].ravel()[node.places])
        if node.op == "sum":
            columns = np.moveaxis(args[0], node.parameter, 0).reshape(args[0].shape[node.parameter], -1).T
            return array_of([f"({'+'.join(parts)})" for parts in columns], node.shape)
        form = _FORMS.get(node.op)
        if node.op == "power":
            form = f"({{}}^{node.parameter})" if node.parameter >= 0 else f"(1/{{}}^{-node.parameter})"
        if form is None:
            raise ModelError(f"Minibex has no {node.op!r}")
        return np.asarray(np.frompyfunc(form.format, len(args), 1)(*args), np.object_)

    def _leaf(self, node: Expr) -> Texts:
        data = node.data
        if node.op == "reading":
            constraints = self._network.constraints
            used = [part for c in constraints for part in c.parts]
            used += [arg for c in constraints for user in topological(c.parts) for arg in user.args]
            if sum(arg.digest == node.digest for arg in used) > 1:
                raise ModelError("a reading that is used twice has one value in both places: Minibex can not say that")
        pairs = zip(data.lo.ravel().tolist(), data.hi.ravel().tolist(), strict=True)
        return array_of([_number(lo) if lo == hi else _interval(lo, hi) for lo, hi in pairs], node.shape)


def _number(value: float) -> str:
    if np.isinf(value):
        return "oo" if value > 0 else "(-oo)"
    return repr(value) if value >= 0.0 else f"({value!r})"


def _interval(lo: float, hi: float) -> str:
    low, high = ("-oo" if np.isinf(lo) else repr(float(lo))), ("oo" if np.isinf(hi) else repr(float(hi)))
    return f"[{low},{high}]"
