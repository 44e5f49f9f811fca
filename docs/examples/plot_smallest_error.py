"""
The smallest model error of each leg
====================================

The joints of a simulated platform move by up to 1 mm in a way that the seven parameters of a leg cannot describe. How
large is the model error then, at least? :func:`cpcal.certify` brackets it by proofs from both sides.
"""

import matplotlib.pyplot as plt
import numpy as np

import cpcal
from cpcal.models import model_residuals

campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0)
result = cpcal.certify(campaign, delta=100.0)
for leg in result.legs:
    print(f"leg {leg.leg}: {cpcal.verdict_of(result, leg).sentence} {cpcal.status_of(result, leg)}")

# %%
# The proved point of leg 1 satisfies every equation to within ``eps_hi``. Some measurements reach that bound: no
# other parameters within 100 mm do better, because these measurements (the support) contradict each other below it.

leg = result.legs[0]
residual = model_residuals(campaign, leg.leg, leg.bracket.point)  # ||P + R b - a|| - (L + l)
support = np.isin(campaign.measurement_ids, leg.support)

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
axes.axhspan(-leg.bracket.hi, leg.bracket.hi, color="#e3ecf7", label="within eps_hi")
axes.plot(np.flatnonzero(~support), residual[~support], "o", color="#2b6cb0", markersize=4, label="measurement")
axes.plot(np.flatnonzero(support), residual[support], "o", color="#c53030", markersize=5, label="support")
axes.set(xlabel="measurement", ylabel="residual [mm]", title="Leg 1: the proved point")
figure.legend(loc="outside lower center", ncols=3)
plt.show()
