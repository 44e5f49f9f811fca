"""The true pose of a robot whose model error is as assumed lies where it is proved to lie."""

from dataclasses import replace

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.leg_set import SIZE, AskedSet, certified_set
from cpcal.models.platform import Cells, Equations, Workspace, cell_bounds, cover, proved_sizes, sizes
from cpcal.robot import (
    Pose,
    Robot,
    central_pose,
    distances,
    forward_kinematics,
    inverse_kinematics,
    leg_vectors,
    normalised,
    quaternion_conjugate,
    quaternion_product,
)
from cpcal.solver.interval import IntervalArray
from tests.models.known_robot import reached_poses


def unseen(known, count, seed):
    readings = np.random.default_rng(seed).uniform(5.0, 135.0, (count, 6))
    return forward_kinematics(known.controller, readings, central_pose(known.controller, np.full(6, 70.0)))


def z_of(one, x):
    alpha, beta, rest = x[:3] - one.controller[:3], x[3:6] - one.controller[3:6], x[6] - one.controller[6]
    return np.concatenate([alpha, beta, [rest, alpha @ alpha + beta @ beta - rest**2], np.outer(alpha, beta).ravel()])


def test_the_certified_set_holds_the_true_parameters(known):
    rng = np.random.default_rng(1)
    for one, x in zip(known.sets, known.truth.parameters, strict=True):
        z = z_of(one, x)
        assert ((one.box.lo <= z) & (z <= one.box.hi)).all()
        along = one.basis.T @ z[:7]
        assert ((one.along.lo <= along + 1e-9) & (along - 1e-9 <= one.along.hi)).all()
    directions = rng.standard_normal((5, SIZE))
    found = one.ranges(directions)
    assert ((found.lo <= directions @ z) & (directions @ z <= found.hi)).all()


def test_a_model_error_that_the_campaign_refutes_leaves_no_set(known):
    wrong = known.campaign.length.copy()
    wrong[3, 0] += 5.0
    campaign = replace(known.campaign, length=wrong)
    x = known.controller.parameters[0]
    assert certified_set(AskedSet(campaign, 1, 0.02, center=x, delta=8.0, controller=x)) is None


def test_the_true_pose_lies_within_both_bounds(known):
    poses = unseen(known, 12, 2)
    found = pose_bounds(poses, known.sets)
    true = reached_poses(known.campaign, known.controller, poses)
    assert found.proved.all()
    position, angle = distances(true, poses)
    assert (position <= found.position).all()
    assert (angle <= found.rotation).all()
    # and what is not of first order counts for little
    assert (found.position <= 1.2 * shares(poses, known.sets).sum(axis=1)).all()


@pytest.mark.parametrize(
    ("reach", "turn", "around"),
    [(3.0, 0.0, (0, 0, 0)), (3.0, 0.01, (0, 0, 0)), (12.0, 0.0, (0, 0, 0)), (3.0, 0.01, (0.1, -0.15, 0.2))],
)
def test_the_bound_of_a_cell_holds_for_every_pose_in_it(known, reach, turn, around):
    rng = np.random.default_rng(5)
    middle = np.concatenate([central_pose(known.controller, np.full(6, 70.0)).position, np.array(around)])
    size = np.array([reach] * 3 + [turn] * 3)
    cells = Cells.of_boxes(IntervalArray((middle - size)[None], (middle + size)[None]))
    over, center = cell_bounds(cells, known.sets)
    assert over.proved.all()
    assert (center.position <= over.position).all()
    drawn = middle + size * rng.uniform(-1.0, 1.0, (20, 6))
    drawn[:4, :3] = middle[:3] + reach * np.array([[1, 1, 1], [1, -1, 1], [-1, 1, -1], [-1, -1, -1]])
    poses = Pose(drawn[:, :3], normalised(np.column_stack([np.ones(20), drawn[:, 3:]])))
    position, angle = distances(reached_poses(known.campaign, known.controller, poses), poses)
    assert (position <= over.position).all()
    assert (angle <= over.rotation).all()
    alone = pose_bounds(poses, known.sets)
    assert (alone.position <= over.position * (1.0 + 1e-9)).all()


def test_the_turns_of_a_cell_are_those_between_its_poses_and_its_centre():
    rng = np.random.default_rng(6)
    middle, size = rng.uniform(-0.5, 0.5, (30, 6)), rng.uniform(0.0, 0.2, (30, 6))
    cells = Cells.of_boxes(IntervalArray(middle - size, middle + size))
    for corner in np.where(rng.uniform(size=(20, 30, 6)) < 0.5, -1.0, 1.0):
        pose = normalised(np.column_stack([np.ones(30), (middle + size * corner)[:, 3:]]))
        turn = quaternion_product(pose, quaternion_conjugate(cells.center.quaternion))
        s = turn[:, 1:] / turn[:, :1]
        assert ((cells.reach.lo[:, 3:] <= s + 1e-12) & (s - 1e-12 <= cells.reach.hi[:, 3:])).all()


@pytest.mark.parametrize("r", [0.1, 0.5, 0.9, 0.99, 1.01, 2.0])
def test_what_is_proved_holds_the_zero_that_is_farthest(r):
    # equations y = v + m y, whose m is anywhere in [-r, r] and v of size 3
    size, proved = proved_sizes(lambda y: r * y, np.full((1, 6), 3.0), np.array([True]))
    assert proved[0] or r > 0.6
    assert not (proved[0] and r >= 1.0)
    if proved[0]:
        assert (size >= 3.0 / (1.0 - r)).all()  # of m = r


def test_a_model_error_moves_the_platform_by_its_square_as_well(known):
    # (L + l + e)^2 - (L + l)^2 = e (2 (L + l) + e), for sets without a width and errors up to a tenth of the legs
    poses = unseen(known, 5, 7)
    length = np.linalg.norm(leg_vectors(known.controller, poses), axis=-1)

    def share(eps):
        return shares(poses, alone(known, eps))

    eps = 40.0
    assert (share(eps) / share(1e-3) >= (eps + eps**2 / (2.0 * length)) / (1e-3 + 5e-7 / length) * (1 - 1e-6)).all()


def shares(poses, sets):
    """(K, n) mm: how far, to first order, what is not known of each leg moves the platform."""
    of = Equations(Cells.of_poses(poses), sets)
    return np.linalg.norm(of.inverse[:, :3], axis=1) * of.with_error(of.deviations()).rad


def alone(known, eps):
    """Sets that hold only the controller's parameters."""
    nothing = IntervalArray.of(np.zeros(SIZE))
    there = {"ranges": lambda directions: IntervalArray.of(np.zeros(len(directions)))}
    return [
        one._replace(eps=eps, box=nothing, along=nothing[:7], controller=row, **there)
        for one, row in zip(known.sets, known.controller.parameters, strict=True)
    ]


@pytest.mark.parametrize("held", [(), (3, 4)])
def test_the_image_holds_what_the_equations_leave_at_every_pose_in_the_box(known, held):
    # y + F(C y) - F(0), F by its definition, with parameters anywhere in the sets; where what is not linear counts most
    rng, sets = np.random.default_rng(9), known.sets
    poses = unseen(known, 3, 8)
    equations = Equations(Cells.of_poses(poses), sets, held)
    image = equations.image(IntervalArray.of(np.zeros((3, 6))))
    drawn = [one.basis @ rng.uniform(one.along.lo, one.along.hi) for one in sets]
    x = Robot.from_parameters(
        "drawn",
        known.controller.parameters
        + np.clip(drawn, *(np.stack([getattr(one.box, side)[:7] for one in sets]) for side in ("lo", "hi"))),
    )
    length = np.linalg.norm(leg_vectors(x, poses), axis=-1)
    for _ in range(100):
        move = equations.inverse @ np.where(rng.uniform(size=(3, 6, 1)) < 0.5, -5.0, 5.0)
        y, move = (equations.jacobian @ move)[..., 0], move[..., 0]
        turn = normalised(np.column_stack([np.ones(3), move[:, 3:]]))
        moved = Pose(poses.position + move[:, :3], quaternion_product(turn, poses.quaternion))
        reached = np.linalg.norm(leg_vectors(x, moved), axis=-1)
        square = (1.0 + (move[:, 3:] ** 2).sum(axis=-1))[:, None]  # of what F(0) s.s holds the middle is 0 here
        left = y - square * (reached**2 - length**2) / (2.0 * equations.scale)
        assert (np.abs(left) <= image(np.abs(y)) + 1e-9).all()


def worst_of(found):
    """mm: proved of all poses in the cells that are proved."""
    return max(cell.state.position for cell in found.cells if cell.state.proved)


def pose_bounds(poses, sets):
    return cell_bounds(Cells.of_poses(poses), sets)[1]


# The search for the worst of a workspace brackets it, and says what it leaves out.


def test_the_cells_cover_the_workspace_and_bound_what_its_poses_attain(known):
    x, y, z = central_pose(known.controller, np.full(6, 70.0)).position
    space = Workspace((x - 12, y - 12, z, 0, 0, 0), (x + 12, y + 12, z, 0, 0, 0))
    seen = []
    found = cover(space, known.sets, gap=0.3, tell=lambda lo, hi: seen.append((lo, hi)))
    assert found.complete
    assert all(cell.state.proved for cell in found.cells)
    assert sum(np.prod(cell.box.width[:2]) for cell in found.cells) == pytest.approx(24.0**2)
    assert found.at_position <= worst_of(found) <= 1.3 * found.at_position
    assert all(lo <= hi for lo, hi in seen)
    rng = np.random.default_rng(1)
    drawn = np.column_stack([rng.uniform(x - 12, x + 12, 8), rng.uniform(y - 12, y + 12, 8), np.full(8, z)])
    alone = pose_bounds(Pose(drawn, np.tile([1.0, 0, 0, 0], (8, 1))), known.sets)
    assert (alone.position <= worst_of(found)).all()


def test_the_halves_of_a_cell_leave_no_gap(known):
    x, y, z = central_pose(known.controller, np.full(6, 70.0)).position
    space = Workspace((x - 40, y - 40, z, -0.1, 0, 0), (x + 40, y + 40, z, 0.1, 0, 0))
    found = cover(space, known.sets, gap=0.0, most=30)
    assert len(found.cells) > 9  # divided beyond the first grid
    assert not found.complete
    wide = (space.box.hi > space.box.lo).nonzero()[0]
    lo, hi = (np.array([getattr(cell.box, side)[wide] for cell in found.cells]) for side in ("lo", "hi"))
    volume = np.prod(hi - lo, axis=1).sum()
    assert volume == pytest.approx(np.prod((space.box.hi - space.box.lo)[wide]), rel=1e-9)
    rng = np.random.default_rng(2)
    ends = np.concatenate([lo, hi])
    drawn = np.where(
        rng.uniform(size=(500, len(wide))) < 0.5,
        rng.uniform(space.box.lo[wide], space.box.hi[wide], (500, len(wide))),
        rng.permuted(ends, axis=0)[rng.integers(0, len(ends), 500)],
    )
    assert ((lo[None] <= drawn[:, None]) & (drawn[:, None] <= hi[None])).all(axis=2).any(axis=1).all()


def test_cells_near_a_singularity_are_left_out_and_the_rest_is_proved(known):
    x, y, z = central_pose(known.controller, np.full(6, 70.0)).position
    space = Workspace((x, y, z, 0, 0, 1.9), (x, y, z, 0, 0, 2.1))  # a quarter turn is 2 S = 2
    found = cover(space, known.sets, most=8)
    bounds = [cell.state for cell in found.cells]
    assert not all(bound.proved for bound in bounds)
    assert all(np.isfinite(bound.position) == bound.proved for bound in bounds)


def test_a_workspace_is_read_with_degrees_for_turns_and_every_mistake_is_named():
    space = Workspace.parsed("x=-50:50, y=1:2,z=400,rx=-2:2")
    assert space.lo[:3] == (-50.0, 1.0, 400.0)
    assert space.hi[3] == pytest.approx(np.radians(2.0))
    assert space.box.hi[3] == pytest.approx(np.radians(1.0))
    for text, said in (
        ("x=1:2,y=1:2", "lacks z"),
        ("x=1:2,y=1:2,q=3", "no range"),
        ("x=2:1,y=0,z=0", "cross or are not finite: x"),
        ("x=a:b", "no range"),
    ):
        with pytest.raises(InputError, match=said):
            Workspace.parsed(text)


def test_a_bound_is_that_of_the_farthest_corner():
    rng = np.random.default_rng(10)
    inverse = rng.normal(size=(4, 6, 6)) * np.array([1.0] * 3 + [1e-3] * 3)[:, None]  # mm, rad
    y = IntervalArray(*np.sort(rng.normal(size=(2, 4, 6)), axis=0))
    position, angle = sizes(inverse, y)
    for corner in rng.integers(0, 2, (500, 4, 6)):
        moved = (inverse @ np.where(corner, y.hi, y.lo)[..., None])[..., 0]
        assert (np.linalg.norm(moved[:, :3], axis=1) <= position).all()
        assert (2.0 * np.arctan(np.linalg.norm(moved[:, 3:], axis=1)) <= angle).all()


def test_parameters_that_do_nothing_at_the_centre_of_a_cell_count_at_its_other_poses(known):
    """As is known of them there, while nothing narrow is known of them by themselves."""
    rng, controller, reach = np.random.default_rng(11), known.controller, 12.0
    middle = central_pose(controller, np.full(6, 70.0))
    vector = leg_vectors(controller, middle)
    form = np.concatenate([-vector, vector @ middle.rotation, -np.linalg.norm(vector, axis=1)[:, None]], axis=1)
    off = rng.uniform(-1.0, 1.0, (6, 7))
    off -= form * (np.sum(form * off, axis=1) / np.sum(form * form, axis=1))[:, None]
    other, sets = Robot.from_parameters("other", controller.parameters + off), []
    for one, row, x in zip(known.sets, controller.parameters, other.parameters, strict=True):
        one = one._replace(controller=row, eps=1e-9, along=IntervalArray.around(np.zeros(7), 3.0))
        z = z_of(one, x)
        exactly = lambda directions, z=z: IntervalArray.around(directions @ z, 1e-9)  # noqa: E731
        sets.append(one._replace(box=IntervalArray.around(z, 1e-9), ranges=exactly))
    place = np.concatenate([middle.position, np.zeros(3)])
    size = np.array([reach] * 3 + [0.0] * 3)
    over, center = cell_bounds(Cells.of_boxes(IntervalArray((place - size)[None], (place + size)[None])), sets)
    corners = np.array([[1, 1, 1], [1, -1, 1], [-1, 1, -1], [-1, -1, -1]])
    poses = Pose(middle.position + reach * corners, np.tile(middle.quaternion, (4, 1)))
    position, angle = distances(forward_kinematics(other, inverse_kinematics(controller, poses), poses), poses)
    assert over.proved.all()
    assert (position <= over.position).all()
    assert (angle <= over.rotation).all()
    assert position.max() > 2.0 * center.position.max()
