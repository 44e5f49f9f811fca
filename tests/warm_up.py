"""The compiled kernels, made once before many workers want them: a cold start takes two minutes of processor time.

python -m tests.warm_up [programs] [networks] [legs] [images] [solutions]
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory


def compile_kernels() -> None:
    """In two processes, which never make the same kernel; those that are in the cache cost next to nothing.

    Legs and solutions call the kernels of programs and of networks: images take as long as those.
    """
    here = Path(__file__).parents[1]
    begun = [
        # what fails there fails again, and is told, where it is used
        subprocess.Popen([sys.executable, "-m", "tests.warm_up", *parts], cwd=here, stderr=subprocess.DEVNULL)
        for parts in (("programs", "networks", "legs"), ("images", "solutions"))
    ]
    for process in begun:
        process.wait()


def _programs() -> None:
    import numpy as np

    from cpcal.solver.linear import Dense

    engine = Dense(np.array([[1.0, 1.0], [-1.0, 0.5]]), np.array([1.0, 0.5]), -np.ones(2), np.ones(2))
    engine.minimize(np.array([-1.0, -1.0]))


def _networks() -> None:
    import cpcal
    from cpcal.solver.network.rows import Rows

    net = cpcal.Network()
    x = net.variable("x", 2, ([0.5, 0.5], [2.0, 2.0]))
    net.add((cpcal.norm(x) - x[0]).within((0.5, 1.0)))
    net.contract(contractors=("hc4",))
    Rows(net).linearize(net.domain.mid)
    square = cpcal.Network()
    y = square.variable("y", 2, ([0.5, 0.5], [2.0, 2.0]))
    square.add([cpcal.sqr(y[0]) + y[1] == 2.0, y[0] * y[1] == 1.0])
    square.contract(contractors=("newton",))


def _images() -> None:
    import numpy as np

    from benchmarks.vision_scenes import FACING
    from cpcal.robot import Pose, quaternion_from_rotation_vector, quaternion_product
    from cpcal.vision.camera import DELTALAB_CAMERA
    from cpcal.vision.measure import measure_pose
    from cpcal.vision.render import render
    from cpcal.vision.target import DELTALAB_TARGET

    turn = quaternion_product(quaternion_from_rotation_vector([0.1, 0.1, 0.2]), FACING)
    pose = Pose(np.array([0.0, 0.0, 600.0]), turn)
    image = render(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    for kind in (image, image.astype(np.uint16) * 257):
        measure_pose(kind, DELTALAB_TARGET, DELTALAB_CAMERA)


def _solutions() -> None:
    import cpcal

    net = cpcal.Network()
    x = net.variable("x", 2, (0.0, 4.0))
    net.add([x[0] * x[1] == 2.0, x[0] == x[1]])
    net.solve()


def _legs() -> None:
    import cpcal

    campaign = cpcal.simulate(seed=1, joint_error=1.0, extremal=False, random_poses=9)
    with TemporaryDirectory() as folder:
        cpcal.certify(campaign, legs=[1], delta=1.0, certificates=folder)


PARTS: dict[str, Callable[[], None]] = {
    "programs": _programs, "networks": _networks, "images": _images, "legs": _legs, "solutions": _solutions
}  # fmt: skip

if __name__ == "__main__":
    for name in sys.argv[1:]:
        PARTS[name]()
