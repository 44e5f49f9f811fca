"""Figures that the paper prints in its tables, for comparison in kind: mm and degrees.

Daney, Andreff, Chabert and Papegay, Interval method for calibration of parallel robots: Vision-based experiments
(2006).
"""

from __future__ import annotations

TABLE_2 = (0.0077, 0.0127, 0.0117, 0.0102, 0.0118, 0.0190)  # mm, legs 1 to 6

# Degrees and mm (the table has m). The paper's angles are Euler angles alpha, beta, gamma; ours are the components of a
# small rotation vector, in the same order.
TABLE_3 = {"x": 0.0633, "y": 0.0230, "z": 0.0608, "rx": 9.23e-3, "ry": 1.19e-2, "rz": 8.94e-3}

TABLE_4 = (  # x_c, mm
    (-220.7358, -148.9040, -1.3908, -20.5951, -191.2210, 0.2772, 334.5216),
    (220.1908, -148.9040, -1.3908, 18.2577, -191.2210, 0.2772, 334.0422),
    (240.5155, -116.3502, -1.3908, 176.4621, 78.6322, 0.2772, 337.5156),
    (20.5843, 264.2345, 3.1014, 156.3954, 110.6810, -0.7735, 333.2639),
    (-18.3513, 265.3592, 3.9762, -155.1999, 112.7371, -0.7923, 334.7650),
    (-242.2035, -115.4354, -2.9053, -175.3203, 80.3917, 0.7341, 337.3083),
)
TABLE_5 = (  # x_c_sigma, mm
    (-226.4666, -148.8772, 7.1414, -24.6547, -191.3399, -5.5916, 345.6908),
    (226.7834, -148.8772, 7.1414, 15.9240, -191.3399, -5.5916, 345.8367),
    (244.1771, -121.0730, 7.1414, 178.4731, 75.4911, -5.5916, 345.9741),
    (17.7684, 270.0970, -16.0551, 158.2606, 109.7645, -2.2261, 347.0417),
    (-17.9290, 267.6828, -12.0433, -153.4852, 113.8857, 9.4908, 343.6362),
    (-244.3333, -118.9524, 6.6741, -174.5178, 83.5386, 9.5100, 345.9276),
)

# Rows: position mean, its deviation, orientation mean, its deviation. The labels in the paper mix degrees and mm; the
# order of the rows is what can be relied on. Columns: before, with x_c, with x_c_sigma.
TABLE_6 = ((1.32, 0.67, 1.10), (0.62, 0.40, 0.45), (0.34, 0.26, 0.26), (0.27, 0.27, 0.27))

TABLE_7_CERTIFIED = (27.38, 26.93, 32.78, 33.42, 25.46, 24.01)  # mm: no solution below
TABLE_7_ATTAINED = (27.53, 26.96, 33.12, 33.48, 25.53, 24.24)  # mm: of a valid point
