"""
A global optimum in Pyomo
=========================

Six-hump camel: six local minima, two of them global. Pyomo's model goes to cpcal as to any other solver; both of its
bounds are proved.
"""

import matplotlib.pyplot as plt
import numpy as np
import pyomo.environ as pyo

from cpcal.problems import pyomo_solver


def camel(x, y):
    return 4 * x**2 - 2.1 * x**4 + x**6 / 3 + x * y - 4 * y**2 + 4 * y**4


model = pyo.ConcreteModel()
model.x, model.y = pyo.Var(bounds=(-2, 2)), pyo.Var(bounds=(-1, 1))
model.goal = pyo.Objective(expr=camel(model.x, model.y))
results = pyomo_solver.SolverFactory("cpcal").solve(model)
print(results.extra_info.sentence)
print(f"least value in [{results.objective_bound:.7f}, {results.incumbent_objective:.7f}]")

# %%

x, y = np.meshgrid(np.linspace(-2, 2, 200), np.linspace(-1, 1, 100))
figure, axes = plt.subplots(figsize=(6, 3.4), layout="constrained")
axes.contour(x, y, camel(x, y), levels=np.linspace(-1, 5, 25), linewidths=0.6)
axes.plot(pyo.value(model.x), pyo.value(model.y), "r*", ms=12)
axes.set(xlabel="x", ylabel="y", aspect="equal")
plt.show()
