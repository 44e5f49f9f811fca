"""
Inverse kinematics of a six-joint arm
=====================================

An elbow manipulator reaches a given pose in sixteen ways (Numerica's problem kin1, read from its Minibex file). All are
proved. Each line is one of them: the angles of its six joints.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import benchmarks
from cpcal.problems.problem import load_problem

network = load_problem(Path(benchmarks.__file__).parent / "problems" / "kin1.bch").network
paving = network.solve()
print(paving.status)

# %%

angles = np.degrees([solution.box.mid for solution in paving.solutions])
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for k, row in enumerate(sorted(angles.tolist())):
    axes.plot(range(1, 7), row, "o-", lw=0.9, ms=3, color=plt.cm.viridis(k / len(angles)))
axes.set(xlabel="joint", ylabel="angle in degrees", xticks=range(1, 7), ylim=(0, 360), yticks=range(0, 361, 60))
plt.show()
