"""Networks that tests state in a line."""

from typing import Any

import cpcal


def network(shape: Any = (), **domains: Any) -> tuple[Any, ...]:
    """A network without constraints, and its unknowns: each of that shape, and in its domain."""
    net = cpcal.Network()
    return net, *(net.variable(name, shape, domain) for name, domain in domains.items())
