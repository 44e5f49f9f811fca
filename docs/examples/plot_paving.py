"""
All solutions of a constraint set
=================================

A ring, cut by a line. :meth:`cpcal.Network.solve` covers the solutions with boxes: all points of the green ones are
proved to be solutions, no point of the grey ones is, and the yellow ones are too small to be split further.
"""

import matplotlib.pyplot as plt
from matplotlib.patches import Rectangle

import cpcal

net = cpcal.Network()
x = net.variable("x", shape=2, domain=(-2.5, 2.5))
net.add(cpcal.norm(x).within((1.0, 2.0)))
net.add(x[0] + x[1] <= 1.0)
paving = net.solve(width=0.1, inner=True)
print(paving.status)
print(f"the area is proved to lie in [{paving.volume.lo:.2f}, {paving.volume.hi:.2f}]")

# %%

figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
for boxes, colour in ((paving.outside, "#e8ecf1"), (paving.boundary, "#f0b429"), (paving.inside, "#2f855a")):
    for box in boxes:
        axes.add_patch(Rectangle(box.lo, *box.width, facecolor=colour, edgecolor="white", linewidth=0.3))
axes.set(xlim=(-2.5, 2.5), ylim=(-2.5, 2.5), aspect="equal", xlabel="x[0]", ylabel="x[1]")
plt.show()
