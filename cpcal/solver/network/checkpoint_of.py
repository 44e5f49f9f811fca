"""Which problem and options a checkpoint is of, so that no other search goes on from it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from cpcal.common.version import __version__
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.dag import topological
from cpcal.solver.network.network import ConstraintNetwork


def checkpoint_of(network: ConstraintNetwork, options: Sequence[object]) -> dict[str, str]:
    """Version, problem and options, as texts that are the same in every process."""
    asked = repr([_plain(option) for option in options])
    return {"version": __version__, "problem": problem_digest(network), "options": asked}


def _plain(option: object) -> object:
    """Contractors and strategies that are objects by the names of their classes."""
    if isinstance(option, np.ndarray):
        return option.tolist()
    if isinstance(option, (list, tuple)):
        return [_plain(part) for part in option]
    return option if option is None or isinstance(option, (str, int, float)) else type(option).__name__


def problem_digest(network: ConstraintNetwork) -> str:
    """SHA-256 of domain and constraints as they are built: the same in every process."""
    domain = network.domain
    digest = hashlib.sha256(repr((network.names, network.whole.tolist())).encode())
    digest.update(domain.lo.tobytes() + domain.hi.tobytes())
    places: dict[bytes, int] = {}
    roots = [expr for c in network.constraints for expr in (c.body, c.lower, c.upper)]
    for node in topological(roots):
        places[node.digest] = len(places)
        below = [places[arg.digest] for arg in node.args]
        digest.update(repr((node.op, node.shape, node.parameter, node.name, below)).encode())
        if isinstance(node.data, IntervalArray):
            digest.update(node.data.lo.tobytes() + node.data.hi.tobytes())
        elif node.data is not None:
            digest.update(node.data.tobytes())
    digest.update(repr([places[root.digest] for root in roots]).encode())
    return digest.hexdigest()
