"""A user-defined constraint set, on real data: the cables of a Hangprinter.

    python docs/examples/hangprinter.py PATH/samples.csv [--certificates FOLDER]

The file holds, for a printer that hangs from four cables, positions of the effector seen by a camera (mm) and
what the four motors' encoders said there (degrees). For each cable we ask for the smallest model error eps with
which some anchor `a`, offset `l0` and scale `s` (and spool build-up `q`) satisfy every measurement:

    | ||p_k - a|| - (l0 + s m_k + q m_k^2) | <= eps          for k = 1 ... N

The anchor may be anywhere within 4 m of the origin in each direction. This is equation (15) of the paper with b = 0
and a length model; nothing in cpcal knows about it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

import cpcal
from cpcal.solver.optimize.bound import Minimum

CABLES = ("a", "b", "c", "d")
REACH = 4000.0  # mm, from the origin to the anchor along each axis
LONGEST = 8000.0  # mm, of a cable at encoder zero
SCALE = 1.0  # mm per degree
BUILD_UP = 1e-5  # mm per degree squared
WORST = 1e4  # mm, of the model error: beyond any use

Floats = npt.NDArray[np.float64]
Found = tuple[str, str, Minimum]  # a cable, a model, and what was found


def load(path: Path) -> tuple[Floats, Floats]:
    """Positions (N, 3) in mm and encoder angles (N, 4) in degrees."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    if rows.shape[1] != 7:
        raise SystemExit(f"{path} has {rows.shape[1]} columns; expected x, y, z and four motor angles")
    return rows[:, :3], rows[:, 3:]


def cable_network(position: Floats, angle: Floats, *, quadratic: bool) -> tuple[cpcal.Network, cpcal.Expr]:
    """The constraint set of one cable, and its variable eps."""
    net = cpcal.Network()
    anchor = net.variable("a", shape=3, domain=(-REACH, REACH))
    length = net.variable("l0", domain=(0.0, LONGEST)) + net.variable("s", domain=(-SCALE, SCALE)) * angle
    if quadratic:
        # angle is exact data, but its square is rounded: give the network the angle and let it square
        length = length + net.variable("q", domain=(-BUILD_UP, BUILD_UP)) * cpcal.sqr(net.constant(angle))
    eps = net.variable("eps", domain=(0.0, WORST))
    net.add((cpcal.norm(position - anchor) - length).within((-eps, eps)))
    net.add(length >= eps)  # a cable is longer than the error of its model
    return net, eps


def smallest_errors(position: Floats, angles: Floats, certificates: Path | None = None) -> Iterator[Found]:
    """Of both models of every cable: the smallest eps from both sides, each by a proof."""
    for k, cable in enumerate(CABLES):
        for model in ("linear", "quadratic"):
            net, eps = cable_network(position, angles[:, k], quadratic=model == "quadratic")
            file = None if certificates is None else certificates / f"{cable}-{model}.cert.jsonl"
            yield cable, model, net.minimize(eps, certificate=file, about=f"cable {cable}, model {model}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, help="samples.csv: x, y, z (mm), four motor angles (degrees)")
    parser.add_argument("--tolerance", type=float, default=2.0, metavar="MM", help="Which models are refuted at it?")
    parser.add_argument(
        "--certificates", type=Path, metavar="FOLDER", help="write proofs there for `cpcal verify FOLDER`"
    )
    options = parser.parse_args()
    if options.certificates:
        options.certificates.mkdir(parents=True, exist_ok=True)
    positions, angles = load(options.path)
    print(f"{len(positions)} measurements; every bound is proved, the anchor anywhere within +-{REACH / 1000:g} m\n")
    print("cable  model       smallest model error (mm)     gap    anchor (mm), middle of its enclosure")
    for cable, model, found in smallest_errors(positions, angles, options.certificates):
        where = ", ".join(f"{v:.1f}" for v in found.enclosure.mid[:3])
        refuted = "  refuted" if found.lo > options.tolerance else ""
        error = f"{cpcal.Interval(found.lo, found.hi):.9f}  {found.hi - found.lo:.0e}"
        print(f"{cable:5}  {model:10}  {error}  ({where}){refuted}")


if __name__ == "__main__":
    main()
