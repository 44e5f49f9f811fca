"""Rigs of two cameras, found from simulated dots: are places and poses as good as stated?

    python -m benchmarks.rigs [--rigs 25] [--seed 100]

Each rig is found from 8 moments with 0.02 px of noise in each dot; then 2 further poses are measured by both cameras,
and by the first alone. Printed: mean squares of errors over stated deviations (1 is honest), with exact cameras, and
with cameras whose numbers are off by what their covariances say.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.vision_scenes import facing_poses, found_dots, one
from cpcal.common.arrays import Floats
from cpcal.robot import Pose, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.files.camera_file import CameraRecord
from cpcal.vision.pose import PoseEstimate, estimate_pose
from cpcal.vision.rig.calibrate_rig import FoundRig, calibrate_rig
from cpcal.vision.rig.joint_pose import joint_pose
from cpcal.vision.rig.rig import EACH, Rig, SeenPlate
from cpcal.vision.target import DELTALAB_TARGET

OTHER = Camera(1024, 768, np.array([950.0, 948.0]), np.array([505.0, 390.0]), np.array([-0.15, 0.05, -2e-4, 1e-4, 0.0]))
TRUE = Rig(
    ("left", "right"),
    (DELTALAB_CAMERA, OTHER),
    np.array([[0.0, 0.0, 0.0], [300.0, 12.0, 65.0]]),
    np.array([[1.0, 0.0, 0.0, 0.0], quaternion_from_rotation_vector(np.array([0.03, -0.45, 0.02]))]),
    np.zeros((2 * EACH, 2 * EACH)),
)
NOISE = 0.02
SPREAD = np.array([0.3, 0.3, 0.4, 0.4, 4e-4, 8e-4, 5e-5, 5e-5, 6e-4])  # of a camera's numbers


def plates(rng: np.random.Generator, count: int) -> list[Pose]:
    """Poses in the first camera's frame that both cameras see."""
    poses = facing_poses(rng, count, depth=(650.0, 800.0), tilt=20.0)
    return [Pose(one(poses, k).position + np.array([20.0, 0.0, 0.0]), one(poses, k).quaternion) for k in range(count)]


def seen(rng: np.random.Generator, plate: Pose, cameras: tuple[Camera, ...]) -> list[SeenPlate]:
    """What both cameras see, as cameras of the given numbers understand it."""
    out = []
    for k, camera in enumerate(cameras):
        centers, numbers = found_dots(rng, DELTALAB_TARGET, TRUE.cameras[k], TRUE.seen_by(k, plate), noise=NOISE)
        covariance = np.tile(NOISE**2 * np.eye(2), (len(numbers), 1, 1))
        pose = estimate_pose(centers, covariance, numbers, DELTALAB_TARGET, camera).pose
        out.append(SeenPlate(k, centers, covariance, numbers, pose))
    return out


def found_rig(rng: np.random.Generator, uncertain: bool) -> FoundRig:
    """A rig from 8 moments, of cameras that are exact, or off by what is stated."""
    cameras = tuple(c.with_numbers(c.numbers + uncertain * SPREAD * rng.standard_normal(9)) for c in TRUE.cameras)
    covariance = np.diag(SPREAD**2) if uncertain else None
    records = {name: CameraRecord(camera, covariance) for name, camera in zip(TRUE.names, cameras, strict=True)}
    return calibrate_rig(records, [seen(rng, plate, cameras) for plate in plates(rng, 8)], DELTALAB_TARGET)


def place_square(rig: Rig) -> float:
    """The mean square of the second camera's errors, by what is stated."""
    wrong = _off(Pose(rig.position[1], rig.quaternion[1]), Pose(TRUE.position[1], TRUE.quaternion[1]))
    return _square(wrong, rig.covariance[EACH : EACH + 6, EACH : EACH + 6])


def measured(rng: np.random.Generator, rig: Rig) -> tuple[Pose, PoseEstimate, PoseEstimate]:
    """A true pose, what both cameras say of it, and what the first says."""
    plate = plates(rng, 1)[0]
    views = seen(rng, plate, rig.cameras)
    return plate, joint_pose(views, rig, DELTALAB_TARGET), joint_pose(views[:1], rig, DELTALAB_TARGET)


def pose_square(found: PoseEstimate, true: Pose) -> float:
    """The mean square of a pose's errors, by what is stated."""
    return _square(_off(found.pose, true), found.covariance)


def _off(pose: Pose, true: Pose) -> Floats:
    turn = quaternion_product(true.quaternion, quaternion_conjugate(pose.quaternion))
    return np.concatenate([true.position - pose.position, rotation_vector(turn)])


def _square(error: Floats, covariance: Floats) -> float:
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=25)
    parser.add_argument("--seed", type=int, default=100)
    given = parser.parse_args()
    for uncertain in (False, True):
        places, both, alone = [], [], []
        for k in range(given.rigs):
            rng = np.random.default_rng(given.seed + k)
            rig = found_rig(rng, uncertain).rig
            places.append(place_square(rig))
            for _ in range(2):
                true, joint, single = measured(rng, rig)
                both.append(pose_square(joint, true))
                alone.append(pose_square(single, true))
        figures = f"the camera's place {np.mean(places):.2f}, poses {np.mean(both):.2f}, by one {np.mean(alone):.2f}"
        print(f"{'calibrated' if uncertain else 'exact':>10} cameras: {figures}")


if __name__ == "__main__":
    main()
