"""
A pose from an image
====================

A target of dots is rendered as a camera sees it, with blur and noise; then the dots are found, identified and the
pose is fitted.
"""

import matplotlib.pyplot as plt
import numpy as np

from cpcal.robot import Pose, transformed
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.measure import measure_pose
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET

truth = Pose(np.array([12.0, -8.0, 700.0]), np.array([0.0, 0.995, 0.1, 0.0]) / np.hypot(0.995, 0.1))
image = render(DELTALAB_TARGET, DELTALAB_CAMERA, truth, Scene(blur=0.8, noise=2.0), seed=1)
found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
error = found.pose.position - truth.position
print(f"{len(found.numbers)} dots; position error {np.abs(error).max():.4f} mm")
print(f"residual {found.estimate.rms:.4f} pixels (rms)")

# %%
# The dots that were identified, and where the fitted pose puts all dots of the target.

pixels = DELTALAB_CAMERA.project(transformed(found.pose, DELTALAB_TARGET.points))
figure, axes = plt.subplots(figsize=(8, 6), layout="constrained")
axes.imshow(image, cmap="gray")
axes.plot(*pixels.T, "o", markersize=9, markerfacecolor="none", markeredgecolor="#c53030", label="all dots, projected")
axes.plot(*pixels[found.numbers].T, ".", markersize=3, color="#2b6cb0", label="identified")
axes.set_axis_off()
axes.legend(loc="lower right")
plt.show()
