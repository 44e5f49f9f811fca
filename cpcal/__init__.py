"""Certified calibration of parallel robots: what no least-squares fit can answer, proved.

campaign = cpcal.load_campaign("campaign/")
result = cpcal.certify(campaign, delta=100.0)
"""

from cpcal.certify import PointResult, certify, certify_point, compare, compare_networks
from cpcal.errors import CpcalError, InputError, ModelError, PluginError
from cpcal.files import load_campaign, save_campaign
from cpcal.legs import LegModel, Measured, Parameter, register_model
from cpcal.results import (
    Comparison,
    LegResult,
    Result,
    VerifiedPoint,
    load_comparison,
    load_result,
    save_comparison,
    save_result,
)
from cpcal.robot import Campaign, Robot
from cpcal.simulate import simulate
from cpcal.solver.contract import Contraction, Contractor, Limits, Polyhedron, Step, Strategy, Verdict
from cpcal.solver.interval import Box, Interval
from cpcal.solver.model import Network, Paving, Solution
from cpcal.solver.network import Constraint, Expr, evaluate, maximum, minimum, norm, sqr, sqrt
from cpcal.version import __version__

__all__ = [
    "Box",
    "Campaign",
    "Comparison",
    "Constraint",
    "Contraction",
    "Contractor",
    "CpcalError",
    "Expr",
    "InputError",
    "Interval",
    "LegModel",
    "LegResult",
    "Limits",
    "Measured",
    "ModelError",
    "Network",
    "Parameter",
    "Paving",
    "PluginError",
    "PointResult",
    "Polyhedron",
    "Result",
    "Robot",
    "Solution",
    "Step",
    "Strategy",
    "Verdict",
    "VerifiedPoint",
    "__version__",
    "certify",
    "certify_point",
    "compare",
    "compare_networks",
    "evaluate",
    "load_campaign",
    "load_comparison",
    "load_result",
    "maximum",
    "minimum",
    "norm",
    "register_model",
    "save_campaign",
    "save_comparison",
    "save_result",
    "simulate",
    "sqr",
    "sqrt",
]
