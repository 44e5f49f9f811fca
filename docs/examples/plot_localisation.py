"""
Where am I, if some ranges are wrong?
=====================================

Eight beacons, eight measured distances, two of them wrong by metres. ``qinter`` keeps the places that all but two of
the measurements allow, whichever two those are: the true place is among them, whatever the errors.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

import cpcal
from contractors import qinter

beacons = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [5, -3], [-3, 5], [13, 5], [5, 13]], dtype=float)
true = np.array([3.0, 4.0])
ranges = np.linalg.norm(beacons - true, axis=1)
ranges[[2, 5]] += [4.0, -1.5]

net = cpcal.Network("localisation")
place = net.variable("p", 2, (-20.0, 20.0))
net.add((cpcal.norm(beacons - place) - ranges).within((-0.1, 0.1)))
print(net.solve(contractors=["hc4"]).status)
paving = net.solve(width=0.02, contractors=[qinter(net, q=2)])
for box in paving.clusters:
    print(f"all but two: {box['p[0]']}, {box['p[1]']}")

# %%

figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
for k, (beacon, distance) in enumerate(zip(beacons, ranges, strict=True)):
    wrong = k in (2, 5)
    axes.add_patch(plt.Circle(beacon, distance, fill=False, color="#c53030" if wrong else "#a0aec0", lw=0.8))
axes.plot(*beacons.T, "k.", label="beacons")
for box in paving.clusters:
    side = np.maximum(box.width, 0.3)
    axes.add_patch(Rectangle(box.mid - side / 2, *side, color="#2f855a"))
axes.plot(*true, "x", color="#dd6b20", label="true place")
axes.set(xlim=(-6, 16), ylim=(-6, 16), aspect="equal", xlabel="x in m", ylabel="y in m")
axes.legend(loc="upper right")
plt.show()
