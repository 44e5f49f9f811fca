"""
A sensor's gain error, found
============================

The length sensors of this platform show one percent too little. The plain leg model cannot fit that, whatever its
parameters; a model with a gain can. :func:`cpcal.compare` proves both.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import cpcal

campaign = cpcal.simulate(seed=1, factor=3.0, truncate=2.9)
campaign = replace(campaign, length=campaign.length / 1.01)
found = cpcal.compare(campaign, ["plain", "gain"], tolerance=0.1, legs=[1, 2, 3])
rows = [(leg.leg, model, leg.bracket.lo) for model, result in found.items() for leg in result.legs]
for model, result in found.items():
    for leg in result.legs:
        print(f"leg {leg.leg}, {model}: {cpcal.verdict_of(result, leg).word}")

# %%
# Left of its mark no parameters of a model satisfy all measurements, whatever the readings in their sets: this is
# proved. A mark at zero says that the model is not refuted.

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
rows.sort()
colours = {"plain": "#c53030", "gain": "#2f855a"}
for row, (_, model, lo) in enumerate(rows):
    axes.plot([lo], [row], "|", color=colours[model], markersize=14, markeredgewidth=3)
axes.axvline(0.1, color="#718096", linestyle="--", label="tolerance 0.1 mm")
axes.set_yticks(range(len(rows)), [f"leg {number}, {model}" for number, model, _ in rows])
axes.set(xlabel="smallest model error [mm], proved lower bound", xlim=(-0.02, None))
axes.invert_yaxis()
axes.legend()
plt.show()
