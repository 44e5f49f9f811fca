"""
Forty assembly modes of a Gough platform
========================================

Six legs of known lengths hold a body. How many ways are there to assemble it? At most 40, and P. Dietmaier found a
platform that has 40 real ones ("The Stewart-Gough platform of general geometry can have 40 real postures", Advances in
Robot Kinematics: Analysis and Control, Kluwer 1998; his numbers are in the demos of PHCpack, too). Here all 40 are
proved, and that there are no others.

The pose is a quaternion x and y = t x / 2 with the translation t (Study parameters). Then each leg is an equation of
second degree: with the joints a and b of a leg, ``L^2 = |t + R b - a|^2`` becomes ::

    |a|^2 + |b|^2 + 4 |y|^2 + 4 <y, x b> - 4 <y, a x> - 2 <a x, x b> = L^2    with |x| = 1, <x, y> = 0

where products are those of quaternions. x and -x are one pose, so that the first component of x is at least 0.
"""

import matplotlib.pyplot as plt
import numpy as np

import cpcal

base = np.array(
    [
        [0, 0, 0],
        [1.107915, 0, 0],
        [0.549094, 0.756063, 0],
        [0.735077, -0.223935, 0.525991],
        [0.514188, -0.526063, -0.368418],
        [0.590473, 0.094733, -0.205018],
    ]
)
body = np.array(
    [
        [0, 0, 0],
        [0.542805, 0, 0],
        [0.956919, -0.528915, 0],
        [0.665885, -0.353482, 1.402538],
        [0.478359, 1.158742, 0.107672],
        [-0.137087, -0.235121, 0.353913],
    ]
)
lengths = [1, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]


def product(p, q):
    """Of two quaternions, scalar first."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def inner(p, q):
    return sum(u * v for u, v in zip(p, q, strict=True))


net = cpcal.Network("Dietmaier's platform")
x = [net.variable("x0", domain=(0, 1)), *net.variable("x", 3, (-1, 1))]
y = list(net.variable("y", 4, (-0.5, 0.5)))  # the first leg is of length 1 and ends in both origins: |t| = 1
net.add([inner(x, x) == 1, inner(x, y) == 0])
for a, b, length in zip(base, body, lengths, strict=True):
    turned, left = product(x, (0, *b)), product((0, *a), x)
    square = a @ a + b @ b + 4 * inner(y, y) + 4 * inner(y, turned) - 4 * inner(y, left) - 2 * inner(left, turned)
    net.add(square == length**2)
paving = net.solve(contractors=["lifted", "newton"], strategy="largest")
print(paving.status, f"({paving.nodes} nodes)")

# %%
# Each of the 40, seen along the base's z axis: base joints black, legs grey, body blue.

figure, panels = plt.subplots(5, 8, figsize=(11, 7), sharex=True, sharey=True, layout="constrained")
for axes in panels.flat:
    axes.axis("off")
for axes, solution in zip(panels.flat, paving.solutions, strict=False):
    pose = solution.box.mid
    turn, half = pose[:4], pose[4:]
    back = turn * [1, -1, -1, -1]
    at = 2 * np.array(product(half, back))[1:]
    joints = np.array([np.array(product(product(turn, (0, *b)), back))[1:] for b in body]) + at
    for foot, joint in zip(base, joints, strict=True):
        axes.plot(*np.array([foot, joint])[:, :2].T, color="#a0aec0", lw=1)
    axes.fill(*joints[[0, 1, 2]][:, :2].T, color="#bee3f8", ec="#2b6cb0")
    axes.plot(*joints[:, :2].T, ".", color="#2b6cb0", ms=4)
    axes.plot(*base[:, :2].T, "k.", ms=4)
    axes.set(aspect="equal")
plt.show()
