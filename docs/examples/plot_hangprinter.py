"""
The anchors of a Hangprinter
============================

A printer hangs from four cables. Its positions are measured, and the motors say how far each cable was wound; where the
anchors are is not known. A constraint set that cpcal has never seen: for each cable the smallest model error eps with
which some anchor a, length l and scale s satisfy every measurement, ``| |p_k - a| - (l + s m_k) | <= eps``. The
measurements are simulated; on real ones ``docs/examples/hangprinter.py`` asks the same.
"""

import matplotlib.pyplot as plt
import numpy as np

import cpcal

rng = np.random.default_rng(1)
anchors = np.array([[0.0, -1620.0, -120.0], [1800.0, 1250.0, -130.0], [-1620.0, 1150.0, -150.0], [-20.0, 10.0, 2350.0]])
position = rng.uniform([-500, -500, 0], [500, 500, 900], (40, 3))

found = []
for anchor in anchors:
    wound = np.linalg.norm(position - anchor, axis=1) - 2000.0
    motor = np.round((wound + rng.uniform(-1, 1, len(wound))) / 0.16)  # whole degrees, and errors of up to 1 mm
    net = cpcal.Network("one cable")
    a = net.variable("a", shape=3, domain=(-4000, 4000))
    cable = net.variable("l", domain=(0, 8000)) + net.variable("s", domain=(-1, 1)) * motor
    eps = net.variable("eps", domain=(0, 1e4))
    net.add([(cpcal.norm(position - a) - cable).within((-eps, eps)), cable >= eps])
    found.append(net.minimize(eps))
    where = ", ".join(f"{v:.0f}" for v in found[-1].solution[a])
    print(f"eps in [{found[-1].lo:.6f}, {found[-1].hi:.6f}] mm, anchor ({where}): {found[-1].status}")

# %%
# Measured positions, true anchors (circles) and those that explain the measurements best (crosses), from above.

figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
axes.plot(position[:, 0], position[:, 1], ".", color="#a0aec0", label="measured positions")
axes.plot(anchors[:, 0], anchors[:, 1], "o", ms=11, mfc="none", color="#2b6cb0", label="anchors")
best = np.array([minimum.witness.point[:3] for minimum in found])
axes.plot(best[:, 0], best[:, 1], "x", ms=8, color="#c53030", label="smallest model error")
axes.set(aspect="equal", xlabel="x in mm", ylabel="y in mm")
axes.legend(loc="lower left")
plt.show()
