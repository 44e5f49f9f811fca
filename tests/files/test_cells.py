"""Names in tables: a spreadsheet runs none of them, and each comes back as it was."""

import csv
import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cpcal.common.documents import guarded, unguarded
from cpcal.files import load_campaign, save_campaign
from cpcal.robot import DELTALAB, Campaign

RUN = "=+-@\uff1d\uff0b\uff0d\uff20"
NAMES = ["=cmd|'calc'!A0", "+1", "-1", "@SUM(A1)", "'=a", "''+b", "'plain", "a=b", "\uff1dx", 'a,"b', "a b", "#", "'"]


@given(st.text(alphabet="'=+-@ab \uff1d", max_size=6) | st.text(max_size=6))
def test_every_name_comes_back_and_none_is_run(name):
    assert unguarded(guarded(name)) == name
    assert guarded(name)[:1] not in tuple(RUN)


def test_pose_ids_that_a_spreadsheet_would_run_are_quoted(tmp_path):
    count = len(NAMES)
    poses = np.zeros((count, 3)), np.tile([1.0, 0, 0, 0], (count, 1)), -np.ones((count, 6))
    campaign = Campaign.of(DELTALAB, *poses, pose=NAMES, run=NAMES[::-1], exact=True)
    save_campaign(campaign, tmp_path)
    rows = list(csv.reader(io.StringIO((tmp_path / "measurements.csv").read_text())))
    assert all(cell[0] not in RUN for row in rows[1:] for cell in row[:2])
    assert rows[1][9] == "-1.0"  # numbers stay numbers
    assert load_campaign(tmp_path) == campaign
