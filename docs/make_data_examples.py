"""Writes the example files of docs/your-data.md into docs/examples/data: one of each kind, from a simulated robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cpcal import Campaign, save_campaign, simulate
from cpcal.robot import Uncertainty

FOLDER = Path(__file__).parent / "examples" / "data"


def rounded(campaign: Campaign) -> Campaign:
    """As instruments print: micrometres, and quaternions of eight digits, normalised."""
    quaternion = np.round(campaign.quaternion, 8)
    return replace(
        campaign,
        position=np.round(campaign.position, 4),
        quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        length=np.round(campaign.length, 4),
        provenance={"date": "2026-01-31", "operator": "A. Example", "serial": "simulated"},
    )


def campaigns(campaign: Campaign) -> None:
    """Three folders: by standard deviations, by half-widths with some rows of their own, exact."""
    sigmas = Uncertainty([0.06, 0.03, 0.06], [1.6e-4, 2e-4, 1.6e-4], [0.01, 0.015, 0.015, 0.01, 0.015, 0.02], 3.0)
    widths = Uncertainty([0.2, 0.1, 0.2], [5e-4, 6e-4, 5e-4], [0.05] * 6)
    for name, stated in (("by-sigma", sigmas), ("by-half-width", widths)):
        radii = np.tile(stated.half_widths, (len(campaign), 1))
        if name == "by-half-width":
            radii[3, :3], radii[7, 6] = 0.5, 0.2  # seen badly; read by hand
        save_campaign(
            Campaign.of(
                campaign.robot,
                campaign.position,
                campaign.quaternion,
                campaign.length,
                pose=campaign.pose,
                run=campaign.run,
                uncertainty=stated,
                position_radius=radii[:, :3],
                rotation_radius=radii[:, 3:6],
                length_radius=radii[:, 6:],
                provenance=campaign.provenance,
            ),
            FOLDER / name,
        )
    zero = {name: np.zeros_like(getattr(campaign, name)) for name in ("position_radius", "rotation_radius")}
    exact = replace(campaign, uncertainty=None, length_radius=np.zeros_like(campaign.length), **zero)
    save_campaign(exact, FOLDER / "exact")


def logs(campaign: Campaign) -> None:
    """Three logs of the same measurements, as three instruments export them; the tracker's is in its own frame."""
    turns = Rotation.from_quat(np.roll(campaign.quaternion, -1, axis=1))
    metres = campaign.position / 1e3
    stands, fixed = (
        Rotation.from_euler("xyz", angles, degrees=True) for angles in ([2.0, -3.0, 140.0], [0, 1.0, 90.0])
    )
    seen = stands.inv().apply(turns.apply([0.03, -0.02, 0.05]) + metres - [2.1, -1.3, 0.9])
    angles = (stands.inv() * turns * fixed).as_euler("xyz", degrees=True)
    names = [
        "Frame",
        "X [m]",
        "Y [m]",
        "Z [m]",
        "Rx [deg]",
        "Ry [deg]",
        "Rz [deg]",
        *(f"L{i} [mm]" for i in range(1, 7)),
    ]
    tracker = ["Laser tracker export 4.2", "Operator: A. Example; 2026-01-31", "", ";".join(names)]
    for row, numbers in enumerate(np.hstack([seen, angles, campaign.length]), 1):
        tracker.append(f"{row};" + ";".join(f"{value:.7f}".replace(".", ",") for value in numbers))
    capture = ["# motion capture; quaternions scalar last", "time,px,py,pz,qx,qy,qz,qw,l1,l2,l3,l4,l5,l6"]
    for row, numbers in enumerate(np.hstack([metres, turns.as_quat(), campaign.length])):
        capture.append(f"{row * 0.5:.1f}," + ",".join(f"{value:.8f}" for value in numbers))
    controller = ["&ACCESS RVP", "; A B C turn about the turned axes Z, Y, X", "N X Y Z A B C E1 E2 E3 E4 E5 E6"]
    for row, numbers in enumerate(np.hstack([campaign.position, turns.as_euler("ZYX", degrees=True), campaign.length])):
        controller.append(f"N{row} " + " ".join(f"{value:.5f}" for value in numbers))
    files = {"laser-tracker.csv": tracker, "motion-capture.csv": capture, "robot-controller.txt": controller}
    for name, lines in files.items():
        (FOLDER / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    made = rounded(simulate(seed=11, extremal=False, random_poses=24))
    campaigns(made)
    logs(made)
