"""What certificates claim with each linear engine, side by side: `python -m benchmarks.engine_claims --seeds 3`.

Campaigns of several seeds, joint errors, readings and leg models; each leg is certified with the compiled simplex and
with GLOP, both certificates are checked, and their claims compared. Claims agree where neither bound of one contradicts
the other, both brackets are closed (or neither), and the enclosures meet. Exits with status 1 where they do not.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

import cpcal
from contractors import Lifted
from cpcal.checker import Accepted, check
from cpcal.files.campaign_json import NAME, save_campaign_json
from cpcal.legs import fit_model, leg_box, leg_model, leg_network, leg_statement
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.limits import Limits
from cpcal.solver.linear import Dense, LinearEngine
from cpcal.solver.linear.glop import Glop
from cpcal.solver.optimize import minimize, run

ENGINES: dict[str, Callable[[], LinearEngine]] = {"dense": Dense, "glop": Glop}
ERRORS, FACTORS, LEGS = (0.0, 1.0, 10.0), (0.0, 3.0), (1, 4)
GAP = 1e-6


def certified(campaign: cpcal.Campaign, leg: int, model: str, engine: str, folder: Path) -> tuple[Accepted, float]:
    """What is accepted of a leg's certificate, and the processor time of search and writer."""
    arithmetic, known = get_arithmetic("float64"), leg_model(model)
    center = fit_model(campaign, leg, known)
    box = leg_box(center, 100.0, known)
    longest = float(np.nextafter(np.min(campaign.length[:, leg - 1]) + box.hi[6], np.inf))
    began = time.process_time()
    network = leg_network(campaign, leg, box, engine=arithmetic, eps=(0.0, longest), model=known)
    lifted = Lifted(network, objective="eps", engine=ENGINES[engine])
    with Recording(leg_statement(campaign, leg, model=model), network.domain) as recording:
        states = minimize(
            network, "eps", [("lifted", lifted)], engine=arithmetic, limits=Limits(gap=GAP, nodes=50),
            start=np.append(center, 0.0), prover=recording.prover, observe=recording.event,
        )  # fmt: skip
        found = run(states, None)
        path = recording.write(folder / f"{engine}.cert.jsonl", claims_of(found, network.domain, "eps"))
    return check(path, folder / NAME), time.process_time() - began


def agree(one: Accepted, two: Accepted) -> bool:
    a, b = one.claims, two.claims
    if None in (a.eps_lo, a.eps_hi, b.eps_lo, b.eps_hi) or a.enclosure is None or b.enclosure is None:
        return (a.eps_lo is None, a.eps_hi is None) == (b.eps_lo is None, b.eps_hi is None)
    assert a.eps_lo is not None and a.eps_hi is not None and b.eps_lo is not None and b.eps_hi is not None  # noqa: PT018
    closed = [hi - lo <= max(GAP * float(hi), 1e-9) for lo, hi in ((a.eps_lo, a.eps_hi), (b.eps_lo, b.eps_hi))]
    lo = [max(pair) for pair in zip(a.enclosure[0], b.enclosure[0], strict=True)]
    hi = [min(pair) for pair in zip(a.enclosure[1], b.enclosure[1], strict=True)]
    meet = all(low <= high for low, high in zip(lo, hi, strict=True))
    return max(a.eps_lo, b.eps_lo) <= min(a.eps_hi, b.eps_hi) and closed[0] == closed[1] and meet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--models", nargs="*", default=["plain", "gain"])
    asked = parser.parse_args()
    worse, ratios = 0, []
    print("seed error factor leg model  |  eps_lo, eps_hi: dense; glop  |  s: dense, glop")
    for seed in range(1, asked.seeds + 1):
        for error in ERRORS:
            for factor in FACTORS:
                campaign = cpcal.simulate(seed=seed, joint_error=error, factor=factor)
                with tempfile.TemporaryDirectory() as name:
                    save_campaign_json(campaign, Path(name))
                    for leg in LEGS:
                        for model in asked.models:
                            found = {e: certified(campaign, leg, model, e, Path(name)) for e in ENGINES}
                            (one, fast), (two, slow) = found["dense"], found["glop"]
                            good = agree(one, two)
                            worse += not good
                            ratios.append(fast / slow)
                            said = "; ".join(
                                f"{float(a.claims.eps_lo or 0):.9f} {float(a.claims.eps_hi or np.inf):.9f}"
                                for a in (one, two)
                            )
                            words = "" if good else "  DIFFERENT"
                            print(f"{seed} {error:4} {factor} {leg} {model:<6} | {said} | {fast:.2f} {slow:.2f}{words}")
    print(f"{len(ratios)} pairs of certificates, {worse} that differ; median of dense / glop {median(ratios):.2f}")
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    main()
