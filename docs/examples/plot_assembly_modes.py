"""
All assembly modes of a planar platform
=======================================

Three legs of known lengths hold a triangle (a 3-RPR platform). How can it be assembled? Three equations in position and
angle; every solution is proved, and that there are no others.
"""

import matplotlib.pyplot as plt
import numpy as np

import cpcal

base = np.array([[0.0, 0.0], [15.91, 0.0], [0.0, 10.0]])
joints = np.array([[0.0, 0.0], [17.04, 0.0], [13.0, 16.0]])
lengths = np.array([14.98, 15.38, 12.0])

net = cpcal.Network("3-RPR")
p = net.variable("p", 2, (-40, 40))
c, s = net.variable("c", domain=(-1, 1)), net.variable("s", domain=(-1, 1))
net.add(cpcal.sqr(c) + cpcal.sqr(s) == 1)
for k in range(3):
    a, b = joints[k]
    place = (p[0] + a * c - b * s, p[1] + a * s + b * c)
    net.add(sum(cpcal.sqr(v - float(w)) for v, w in zip(place, base[k], strict=True)) == float(lengths[k]) ** 2)
paving = net.solve()
print(paving.status)
print(paving.method)

# %%

modes = [solution.box.mid for solution in paving.solutions]
figure, panels = plt.subplots(1, len(modes), figsize=(2.2 * len(modes), 3), layout="constrained", squeeze=False)
for axes, (x, y, cosine, sine) in zip(panels[0], modes, strict=True):
    corners = np.array([x, y]) + joints @ np.array([[cosine, sine], [-sine, cosine]])
    axes.fill(*corners.T, color="#bee3f8", ec="#2b6cb0")
    for foot, corner in zip(base, corners, strict=True):
        axes.plot(*np.array([foot, corner]).T, color="#4a5568")
    axes.plot(*base.T, "k^")
    axes.set(aspect="equal", xticks=[], yticks=[])
plt.show()
