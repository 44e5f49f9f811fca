"""Everything that can be asked: cpcal by its contractors' names, and peers, each behind a small adapter."""

from __future__ import annotations

import importlib

from benchmarks.methods.method import Method, TaskQuestion, Work

PEERS = {
    "scip": "benchmarks.methods.scip:Scip",
    "gurobi": "benchmarks.methods.gurobi:Gurobi",
    "codac": "benchmarks.methods.codac:Codac",
    "codac-fwdbwd": "benchmarks.methods.codac:CodacFwdBwd",
    "least-squares": "benchmarks.methods.levenberg_marquardt:LeastSquares",
}

__all__ = ["PEERS", "Method", "TaskQuestion", "Work", "method"]


def method(name: str) -> Method:
    """A peer, a `module:Class` of a user, or cpcal with contractors, "hc4,lifted"."""
    if name in PEERS or ":" in name:
        module, _, member = PEERS.get(name, name).partition(":")
        made: Method = getattr(importlib.import_module(module), member)()
        return made
    from benchmarks.methods.ours import Cpcal

    return Cpcal(tuple(name.split(",")))
