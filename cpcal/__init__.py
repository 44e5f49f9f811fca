"""Certified calibration of parallel robots: what no least-squares fit can answer, proved.

campaign = cpcal.load_campaign("campaign/")
result = cpcal.certify(campaign, delta=100.0)
"""

from cpcal.calibration import LegModel, Measured, Parameter, register_model
from cpcal.certify import PointResult, certify, certify_point
from cpcal.comparison import Comparison, compare, compare_networks, load_comparison, save_comparison
from cpcal.errors import CpcalError, InputError, ModelError, PluginError
from cpcal.interfaces import Contraction, Contractor, Limits, Polyhedron, Step, Strategy, Verdict
from cpcal.interval import Box, Interval
from cpcal.judged import Judged
from cpcal.network import Constraint, Expr, evaluate, maximum, minimum, norm, sqr, sqrt
from cpcal.result import LegResult, Result, load_result, save_result
from cpcal.robot import Campaign, Robot, load_campaign, save_campaign, simulate
from cpcal.solver import Network, Paving, Solution
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
    "Judged",
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
