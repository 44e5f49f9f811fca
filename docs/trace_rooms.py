"""Through which rooms does a measurement pass? Runs it and notes each room when its code first runs.

    python docs/trace_rooms.py file         from campaign.toml and measurements.csv to a certificate's lines
    python docs/trace_rooms.py image        from an image to the pose of the target in it

For another revision, name the folder of its files in PYTHONPATH. Rooms are those of draw_imports.py.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np

import cpcal

PACKAGES = ("cpcal", "contractors")


def traced(work: Callable[[], object]) -> list[str]:
    """Rooms in the order in which a function of theirs is first called; imports do not count."""
    seen: dict[str, None] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        name = frame.f_globals.get("__name__", "")
        if event == "call" and name.split(".")[0] in PACKAGES and frame.f_code.co_name not in ("<module>", "<lambda>"):
            parts = name.split(".")
            seen.setdefault(parts[0] if len(parts) == 1 or parts[0] != "cpcal" else parts[1])

    work()  # once before: all is imported, all that is compiled or cached is there
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return [room for room in seen if room != "__getattr__"]


def from_file(folder: Path) -> Callable[[], object]:
    """The campaign is read, leg 1 certified, its certificate written."""
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=3.0), folder / "campaign")

    def work() -> object:
        campaign = cpcal.load_campaign(folder / "campaign")
        return cpcal.certify(campaign, legs=[1], gap=1e-2, certificates=folder / "run")

    return work


def from_image(folder: Path) -> Callable[[], object]:
    """One rendered image is measured."""
    from cpcal.robot import Pose
    from cpcal.vision.camera import DELTALAB_CAMERA
    from cpcal.vision.measure import measure_pose
    from cpcal.vision.render import Scene, render
    from cpcal.vision.target import DELTALAB_TARGET

    truth = Pose(np.array([12.0, -8.0, 700.0]), np.array([0.0, 1.0, 0.0, 0.0]))
    image = render(DELTALAB_TARGET, DELTALAB_CAMERA, truth, Scene(blur=0.8), seed=1)
    return lambda: measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)


def main() -> None:
    ways = {"file": from_file, "image": from_image}
    if sys.argv[1:] not in [[name] for name in ways]:
        raise SystemExit(__doc__)
    with tempfile.TemporaryDirectory() as folder:
        rooms = traced(ways[sys.argv[1]](Path(folder)))
    print(len(rooms), " > ".join(rooms))


if __name__ == "__main__":
    main()
