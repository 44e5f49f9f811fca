"""How many images a second `cpcal image detect` makes poses of, and where the time goes.

    python -m benchmarks.throughput [--images 512] [--workers 1 2] [--kinds png tiff jpg] [--folder DIR] [--json FILE]

The study's images (1024 x 768, blur 0.8 px, noise 2 grey levels, 8 bits) are rendered into DIR first, as PNG, and
rewritten as the other kinds, as OpenCV writes them; that is not counted, and files that are there are used again.
`--images 14784 --kinds png` is the paper's whole study, six gigabytes. Then `detect` goes over each folder with each
number of workers. "a core" is processor time of all workers together, "wall" is what a person waits, start of the
workers included. The paper took 3 hours for 14,784 images: 1.4 a second.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from cpcal.robot import PoseTable
from cpcal.simulate import simulate_study
from cpcal.vision.batch.detect import ImageFolder, detect
from cpcal.vision.batch.study_images import RenderedImages, camera_above
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.detection import detections_bytes
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene
from cpcal.vision.target import DELTALAB_TARGET

WHOLE = 14_784
SEED = 1


def rendered(count: int, folder: Path) -> None:
    """The first `count` images of the study in `folder`; those that are there stay."""
    study = simulate_study(
        seed=SEED, images=11, pose_noise=0.0, camera=camera_above(seed=SEED), sag=2.0, axis_offset=2.0
    )
    for name, table in (("calibration", study.calibration), ("validation", study.validation)):
        images = _images(table)
        wanted = images.names[: max(count, 0)]
        count -= len(wanted)
        missing = tuple(n for n in wanted if not (folder / name / n).exists())
        if missing:
            RenderedImages(
                tuple(missing), _rows(images, missing), images.target, images.camera, images.scene, SEED
            ).write(folder / name)


def _images(table: PoseTable) -> RenderedImages:
    return RenderedImages.of(table, DELTALAB_TARGET, DELTALAB_CAMERA, Scene(gradient=(0.25, 0.15)), seed=SEED)


def _rows(images: RenderedImages, names: tuple[str, ...]) -> Any:
    place = {name: k for k, name in enumerate(images.names)}
    rows = [place[name] for name in names]
    return type(images.poses)(images.poses.position[rows], images.poses.quaternion[rows])


def rewritten(source: Path, folder: Path, kind: str) -> None:
    """The images of `source` in another kind of file; those that are there stay."""
    cv2 = opencv()
    for name in ImageFolder(source).names:
        file = (folder / name).with_suffix(f".{kind}")
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), cv2.imread(str(source / name), cv2.IMREAD_UNCHANGED))


def timed(folder: Path, workers: list[int]) -> dict[str, Any]:
    """By the number of workers: seconds waited, seconds of work by stage, poses; the tables must be the same."""
    out: dict[str, Any] = {}
    tables = set()
    for count in workers:
        start = perf_counter()
        found = detect(ImageFolder(folder), DELTALAB_TARGET, DELTALAB_CAMERA, workers=count)
        wall = perf_counter() - start
        tables.add(detections_bytes(found.rows))
        poses = sum(row.found for row in found.rows)
        out[str(count)] = {"images": len(found.rows), "poses": poses, "wall": wall, "work": found.seconds}
    if len(tables) != 1:
        raise AssertionError("the table depends on the number of workers")
    return out


def show(kind: str, results: dict[str, Any]) -> None:
    print(f"{kind:>8}{'images':>9}{'poses':>9}{'wall s':>9}{'images/s':>10}{'a core/s':>10}  ms an image by stage")
    for workers, one in results.items():
        work = sum(one["work"].values())
        stages = ", ".join(f"{stage} {1e3 * seconds / one['images']:.1f}" for stage, seconds in one["work"].items())
        pace, core = one["images"] / one["wall"], one["images"] / work
        print(
            f"{workers:>8}{one['images']:>9,}{one['poses']:>9,}{one['wall']:>9.1f}{pace:>10.1f}{core:>10.1f}  {stages}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=512)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--kinds", nargs="+", default=["png", "tiff", "jpg"], choices=["png", "tiff", "jpg"])
    parser.add_argument("--folder", type=Path, help="for the images; left out: a temporary one")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        rendered(given.images, folder / "png")
        for kind in given.kinds:
            if kind != "png":
                rewritten(folder / "png", folder / kind, kind)
            results[kind] = timed(folder / kind, given.workers)
            show(kind, results[kind])
    if given.json:
        given.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
