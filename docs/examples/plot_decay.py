"""
Exponential decay with bounded errors
=====================================

Eight readings of ``a exp(-b t)``, each known to within 0.15. Green: parameters that agree with all readings, proved.
Outside of the yellow boxes there are none.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

import cpcal

t = np.linspace(0.0, 3.5, 8)
read = np.array([2.07, 1.32, 0.66, 0.52, 0.21, 0.23, 0.03, 0.11])

net = cpcal.Network("decay")
a, b = net.variable("a", domain=(0.0, 5.0)), net.variable("b", domain=(0.0, 5.0))
net.add((a * np.exp(-b * t) - read).within((-0.15, 0.15)))
paving = net.solve(width=0.01, inner=True, contractors=["hc4"], strategy="smear-relative")
print(paving.status)
print(f"the area of all such (a, b) is proved to lie in [{paving.volume.lo:.4f}, {paving.volume.hi:.4f}]")

# %%

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
for boxes, colour in ((paving.boundary, "#f0b429"), (paving.inside, "#2f855a")):
    for box in boxes:
        left.add_patch(Rectangle(box.lo, *box.width, facecolor=colour, edgecolor="white", linewidth=0.2))
left.autoscale_view()
left.set(xlabel="a", ylabel="b")
time = np.linspace(0, 3.5, 100)
for box in paving.inside[:: max(len(paving.inside) // 40, 1)]:
    right.plot(time, box.mid[0] * np.exp(-box.mid[1] * time), color="#2f855a", lw=0.4)
right.errorbar(t, read, 0.15, fmt="k.", capsize=2)
right.set(xlabel="t", ylabel="reading")
plt.show()
