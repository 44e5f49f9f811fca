"""Examples of Pyomo's own repository: `python -m benchmarks.pyomo_examples PATH/TO/pyomo/examples [NAME ...]`.

A checkout of Pyomo is needed, its package does not hold them. Each file is run up to the line where it calls a
solver; the model goes to cpcal through `pyomo.contrib.solver`, disjunctions as big-M. `--bounds B` gives
variables without bounds -B and B, which the printed line says.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pyomo.environ as pyo

from benchmarks.solver_problems import processor_limit
from cpcal.common.errors import CpcalError
from cpcal.problems import pyomo_solver

_CALLS = ("SolverFactory(", "__main__", ".pprint()")
_REACTOR = {"k1": 5.0 / 6.0, "k2": 5.0 / 3.0, "k3": 1.0 / 6000.0, "caf": 10000.0}
_ICE_CREAM: tuple[Any, ...] = (
    ["I_C_Scoops", "Peanuts"],
    {"I_C_Scoops": 1, "Peanuts": 0.1},
    {"I_C_Scoops": 5, "Peanuts": 27},
    {"I_C_Scoops": 3.14, "Peanuts": 0.2718},
    12,
    {"I_C_Scoops": 100, "Peanuts": 40.6},
)

Names = dict[str, Any]
EXAMPLES: dict[str, Callable[[Names], Any]] = {  # and how the names that a file defines become a model
    "pyomobook/nonlinear-ch/multimodal/multimodal_init1.py": lambda file: file["model"],
    "pyomobook/nonlinear-ch/rosen/rosenbrock.py": lambda file: file["model"],
    "pyomobook/nonlinear-ch/react_design/ReactorDesign.py": lambda file: file["create_model"](**_REACTOR),
    "pyomobook/nonlinear-ch/deer/DeerProblem.py": lambda file: file["model"].create_instance("DeerProblem.dat"),
    "pyomobook/nonlinear-ch/disease_est/disease_estimation.py": lambda file: file["instance"],
    "pyomobook/optimization-ch/ConcreteH.py": lambda file: file["IC_model"](*_ICE_CREAM),
    "pyomo/concrete/knapsack-concrete.py": lambda file: file["M"],
    "pyomo/concrete/sodacan.py": lambda file: file["M"],
    "pyomo/amplbook2/diet.py": lambda file: file["model"].create_instance("diet.dat"),
    "pyomo/amplbook2/prod.py": lambda file: file["model"].create_instance("prod.dat"),
    "pyomo/amplbook2/econmin.py": lambda file: file["model"].create_instance("econ.dat"),
    "pyomo/amplbook2/steel3.py": lambda file: file["model"].create_instance("steel3.dat"),
    "gdp/small_lit/ex1_Lee.py": lambda file: file["build_model"](),
    "gdp/small_lit/ex_633_trespalacios.py": lambda file: file["build_simple_nonconvex_gdp"](),
    "gdp/two_rxn_lee/two_rxn_model.py": lambda file: file["build_model"](),
    "pyomobook/scripts-ch/warehouse_model.py": lambda file: file["create_wl_model"](*_warehouse()),
}


def _warehouse() -> tuple[Any, ...]:
    """The first rows of the book's table of distances."""
    sites, places = ["Harlingen", "Memphis", "Ashland"], ["NYC", "LA", "Chicago", "Houston"]
    rows = ((1956, 1606, 1410, 330), (1096, 1792, 531, 567), (485, 2322, 324, 1236))
    pairs = [(site, place) for site in sites for place in places]
    return sites, places, dict(zip(pairs, [d for row in rows for d in row], strict=True)), 2


def model_of(path: Path, make: Callable[[Names], Any], bounds: float) -> tuple[Any, int]:
    """The model of a file, and to how many of its variables bounds were given."""
    lines = []
    for line in path.read_text(encoding="utf-8").split("\n"):
        if not line.startswith((" ", "#")) and any(call in line for call in _CALLS):
            break
        lines.append(line)
    names: Names = {"__name__": "example"}
    with chdir(path.parent):
        exec(compile("\n".join(lines), str(path), "exec"), names)
        model = make(names)
    pyo.TransformationFactory("gdp.bigm").apply_to(model)
    given = 0
    for variable in model.component_data_objects(pyo.Var, descend_into=True):
        low, high = variable.bounds
        if low is None or high is None:
            variable.setlb(-bounds if low is None else low)
            variable.setub(bounds if high is None else high)
            given += 1
    return model, given


def lines(folder: Path, names: list[str], limit: float, bounds: float) -> Iterator[str]:
    """The rows of a table: of the examples with such a name in their path, or of all."""
    solver = pyomo_solver.SolverFactory("cpcal")
    yield "| example | variables | bounds given | bracket | ended as | processor s |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, make in EXAMPLES.items():
        if names and not any(part in name for part in names):
            continue
        began = time.process_time()
        try:
            model, given = model_of(folder / name, make, bounds)
            count = len(list(model.component_data_objects(pyo.Var, descend_into=True)))
            with processor_limit(limit):
                found = solver.solve(model, raise_exception_on_nonoptimal_result=False, load_solutions=False)
            best, bound = found.incumbent_objective, found.objective_bound
            said = f"{_text(bound)} .. {_text(best)} | {found.termination_condition.name}"
        except (CpcalError, ValueError, KeyError, OSError) as error:
            count, given, said = 0, 0, f"| {type(error).__name__}: {str(error).splitlines()[0][:90]}"
        yield f"| {name} | {count} | {given} | {said} | {time.process_time() - began:.1f} |"


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.8g}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--limit", type=float, default=30.0)
    parser.add_argument("--bounds", type=float, default=1e6)
    given = parser.parse_args()
    for line in lines(given.folder.absolute(), given.names, given.limit, given.bounds):
        print(line, flush=True)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
