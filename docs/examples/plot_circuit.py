"""
Operating points of a circuit
=============================

A tunnel diode behind a resistor: its current rises, falls and rises again with the voltage, so that the load line may
meet it three times. A simulator finds one operating point, from where it starts; here all are found, proved.
"""

import matplotlib.pyplot as plt
import numpy as np

import cpcal

resistor = 13_300.0  # ohm


def diode(v):
    """Current in A at a voltage in V: a polynomial through the three branches."""
    return 1e-4 * (2.5 * v**3 - 10.5 * v**2 + 11.8 * v)


for volts in (5.1, 9.0):
    other = cpcal.Network(f"{volts:g} V")
    v = other.variable("v", domain=(0.0, 10.0))
    other.add(diode(v) * resistor + v == volts)
    paving = other.solve()
    points = sorted(float(s.box.mid[0]) for s in paving.solutions)
    print(f"{volts:g} V: {paving.status} v = {', '.join(f'{p:.4f}' for p in points)}")
    if volts == 5.1:
        found = points

# %%

figure, axes = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
volts = np.linspace(0, 3.2, 200)
axes.plot(volts, 1e3 * diode(volts), label="diode")
axes.plot(volts, 1e3 * (5.1 - volts) / resistor, label="load line, 5.1 V")
axes.plot(found, [1e3 * diode(p) for p in found], "ko", label="operating points")
axes.set(xlabel="voltage in V", ylabel="current in mA", ylim=(0, 1))
axes.legend()
plt.show()
