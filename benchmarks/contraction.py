"""What one contraction costs and gains on a leg: the paper's contractors beside hc4, lifted and the classical methods.

    python -m benchmarks.contraction [--repeat 5] [--measurements 64]

Leg 1 of a simulated DeltaLab platform, in a box whose midpoint is 0.3 half-widths from the true parameters in every
coordinate; "width" is the share left of the seven parameters' widths, on average (of the best one). Three cases:

    perfect     noiseless readings declared exact, eps <= 0.001 mm: the solutions fill almost nothing of the box
    exact       noisy readings declared exact, eps <= 0.6 mm
    uncertain   noisy readings within 3 standard deviations, eps <= 0.1 mm
"""

from __future__ import annotations

import argparse
import statistics
import time
from functools import partial
from typing import Any

import numpy as np

from contractors import HC4, Beaumont, Krawczyk, Lifted, LinearSystem
from contractors.linear_system import Method
from cpcal.legs import leg_box, leg_network
from cpcal.robot import Campaign
from cpcal.simulate import simulate, true_robot
from cpcal.solver.contract import Contractor, ContractorFactory, Repeat
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.network import ConstraintNetwork


def _repeated(network: ConstraintNetwork, *, method: Method, **options: Any) -> Contractor:
    """A classical method until the widths no longer shrink, as krawczyk does within one call."""
    return Repeat(LinearSystem(network, method=method, **options))


CONTRACTORS: dict[str, ContractorFactory] = {
    "hc4": HC4,
    "gauss": partial(_repeated, method="gauss"),
    "krawczyk's linear": partial(_repeated, method="krawczyk"),
    "rump": partial(_repeated, method="rump"),
    "krawczyk": Krawczyk,
    "beaumont": Beaumont,
    "krawczyk, slopes": partial(Krawczyk, slopes=True),
    "beaumont, slopes": partial(Beaumont, slopes=True),
    "lifted": Lifted,
}
CASES = {"perfect": (0.0, 1e-3), "exact": (1.0, 0.6), "uncertain": (1.0, 0.1)}  # noise, largest eps (mm)


def network(case: str, delta: float, runs: int) -> ConstraintNetwork:
    noise, eps = CASES[case]
    campaign = simulate(seed=1, runs=runs, noise=noise, truncate=2.9)
    truth = true_robot(campaign)
    assert truth is not None
    center = truth.parameters[0] + 0.3 * delta * np.array([1, -1, 1, 1, -1, 1, -1])
    if case != "uncertain":
        campaign = Campaign.of(campaign.robot, campaign.position, campaign.quaternion, campaign.length, exact=True)
    return leg_network(campaign, 1, leg_box(center, delta), engine=get_arithmetic("float64"), eps=(0.0, eps))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--measurements", type=int, default=64, help="a multiple of 64")
    options = parser.parse_args()
    print(f"{'case':10} {'half-width':>10} {'contractor':18} {'ms':>8} {'LPs':>4}  width")
    for case in CASES:
        for delta in (0.3, 1.0, 10.0, 100.0):
            net = network(case, delta, options.measurements // 64)
            for name, make in CONTRACTORS.items():
                contractor = make(net, objective="eps", arithmetic="float64")
                times = []
                for _ in range(options.repeat):
                    began = time.perf_counter()
                    result = contractor.contract(net.domain)
                    times.append(time.perf_counter() - began)
                left = (result.box.width / net.domain.width)[:7]
                share = "empty" if result.box.is_empty else f"{left.mean():.4f} ({left.min():.4f})"
                milliseconds = 1e3 * statistics.median(times)
                print(f"{case:10} {delta:10g} {name:18} {milliseconds:8.1f} {result.programs:4}  {share}")


if __name__ == "__main__":
    main()
