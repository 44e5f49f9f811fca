"""The law of sqrt(N) dip for uniform samples, by simulation: writes cpcal/calibration/dip_table.py.

python -m benchmarks.dip_law [--samples 5000] > cpcal/calibration/dip_table.py
"""

from __future__ import annotations

import argparse

import numpy as np

from cpcal.calibration.dip import dip

SIZES = (10, 15, 20, 30, 50, 70, 100, 200, 400, 700, 1000)
SURVIVAL = (0.999, 0.99, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01)
TAIL = 0.05  # share of the samples that the tail log p = c - d x^2 is fitted to


def law(size: int, samples: int) -> tuple[list[float], list[float]]:
    """Values that sqrt(N) dip exceeds with the probabilities SURVIVAL, and the tail's (-d, c)."""
    stream = np.random.default_rng(size)
    found = np.sort([dip(stream.random(size)) for _ in range(samples)]) * np.sqrt(size)
    count = int(TAIL * samples)
    share = (np.arange(count, 0, -1) - 0.5) / samples
    tail = np.polyfit(found[-count:] ** 2, np.log(share), 1)
    return np.quantile(found, 1.0 - np.array(SURVIVAL)).tolist(), tail.tolist()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=5000)
    options = parser.parse_args()
    laws = {size: law(size, options.samples) for size in SIZES}
    how = f"`python -m benchmarks.dip_law`, {options.samples} samples each"
    print(f'"""The law of sqrt(N) dip for uniform samples: {how}."""')
    print("\nfrom __future__ import annotations\n")
    print(f"SURVIVAL = {SURVIVAL}\n")
    print("# by N: values exceeded with those probabilities; beyond the last one, log p = c - d x^2 with (-d, c)")
    print("LAWS: dict[int, tuple[tuple[float, ...], tuple[float, float]]] = {")
    for size, (values, tail) in laws.items():
        print(f"    {size}: (")
        half, text = len(values) // 2, [f"{value:.5f}" for value in values]
        print(
            "        (",
            *(f"            {', '.join(part)}," for part in (text[:half], text[half:])),
            "        ),",
            sep="\n",
        )
        print(f"        ({tail[0]:.4f}, {tail[1]:.4f}),")
        print("    ),")
    print("}")


if __name__ == "__main__":
    main()
