from .accuracy import Accuracy, NamedPoses, Workspace, certify_accuracy
from .certify import (
    DataCheck,
    PointResult,
    certify,
    certify_point,
    certify_robust,
    check_data,
    compare,
    compare_networks,
    with_ranges,
)
from .common.errors import CpcalError, InputError, ModelError, PluginError
from .common.version import __version__
from .files import load_campaign, save_campaign
from .legs import LegModel, Measured, Parameter
from .report import write_report
from .results import (
    Comparison,
    LegResult,
    Result,
    VerifiedPoint,
    load_comparison,
    load_result,
    save_comparison,
    save_result,
    status_of,
    verdict_of,
)
from .robot import Campaign, Robot
from .simulate import simulate
from .solver.contract import Contraction, Contractor, Limits, Polyhedron, Step, Strategy, Verdict
from .solver.interval import Box, Interval
from .solver.model import Network, Paving, Solution
from .solver.network import Constraint, Expr, evaluate, maximum, minimum, norm, sqr, sqrt

__all__ = [
    "Accuracy",
    "Box",
    "Campaign",
    "Comparison",
    "Constraint",
    "Contraction",
    "Contractor",
    "CpcalError",
    "DataCheck",
    "Expr",
    "InputError",
    "Interval",
    "LegModel",
    "LegResult",
    "Limits",
    "Measured",
    "ModelError",
    "NamedPoses",
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
    "Workspace",
    "__version__",
    "certify",
    "certify_accuracy",
    "certify_point",
    "certify_robust",
    "check_data",
    "compare",
    "compare_networks",
    "evaluate",
    "load_campaign",
    "load_comparison",
    "load_result",
    "maximum",
    "minimum",
    "norm",
    "save_campaign",
    "save_comparison",
    "save_result",
    "simulate",
    "sqr",
    "sqrt",
    "status_of",
    "verdict_of",
    "with_ranges",
    "write_report",
]
