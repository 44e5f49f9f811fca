"""The search for the worst of a workspace brackets it, and says what it leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.platform import Workspace, cover, pose_bounds
from cpcal.robot import Pose, central_pose


def test_the_cells_cover_the_workspace_and_bound_what_its_poses_attain(known):
    x, y, z = central_pose(known.controller, np.full(6, 70.0)).position
    space = Workspace((x - 12, y - 12, z, 0, 0, 0), (x + 12, y + 12, z, 0, 0, 0))
    seen = []
    found = cover(space, known.sets, gap=0.3, tell=lambda lo, hi: seen.append((lo, hi)))
    assert found.complete
    assert found.proved.all()
    area = np.prod((found.boxes.hi - found.boxes.lo)[:, :2], axis=1).sum()
    assert area == pytest.approx(24.0**2)
    assert found.at_position <= found.worst <= 1.3 * found.at_position
    assert all(lo <= hi for lo, hi in seen)
    rng = np.random.default_rng(1)
    drawn = np.column_stack([rng.uniform(x - 12, x + 12, 8), rng.uniform(y - 12, y + 12, 8), np.full(8, z)])
    alone = pose_bounds(Pose(drawn, np.tile([1.0, 0, 0, 0], (8, 1))), known.sets)
    assert (alone.position <= found.worst).all()


def test_the_halves_of_a_cell_leave_no_gap(known):
    x, y, z = central_pose(known.controller, np.full(6, 70.0)).position
    space = Workspace((x - 40, y - 40, z, -0.1, 0, 0), (x + 40, y + 40, z, 0.1, 0, 0))
    found = cover(space, known.sets, gap=0.0, most=30)
    assert len(found.boxes.lo) > 9  # divided beyond the first grid
    assert not found.complete
    assert (found.position[found.proved] <= found.worst).all()
    wide = (space.box.hi > space.box.lo).nonzero()[0]
    lo, hi = found.boxes.lo[:, wide], found.boxes.hi[:, wide]
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
    assert not found.proved.all()
    assert np.isfinite(found.position[found.proved]).all()
    assert np.isinf(found.position[~found.proved]).all()


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
