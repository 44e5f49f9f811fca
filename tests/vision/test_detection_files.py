"""The tables between images and a study: poses.csv and leg readings, written and read back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.errors import InputError
from cpcal.simulate import simulate_study
from cpcal.vision.batch.study_images import study_table
from cpcal.vision.files.detection import NUMBERS, Detection, detections_bytes, load_detections
from cpcal.vision.files.readings import load_readings, readings_bytes, readings_of

NAMES = st.lists(st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1), unique=True, max_size=6)
ROW = st.tuples(*[st.floats(-1e9, 1e9) for _ in NUMBERS])


@given(names=NAMES, data=st.data())
def test_detections_are_read_back_bit_for_bit(tmp_path_factory, names, data):
    rows = []
    for name in names:
        reason = data.draw(st.sampled_from(["", "no dots", 'odd, "quoted"\nreason']))
        values = () if reason else data.draw(ROW)
        doubt = "" if reason else data.draw(st.sampled_from(["", 'large, "odd" residuals']))
        rows.append(Detection(name, reason, data.draw(st.integers(0, 200)), values, doubt))
    path = tmp_path_factory.mktemp("rows") / "poses.csv"
    path.write_bytes(detections_bytes(rows))
    assert load_detections(path) == sorted(rows, key=lambda d: d.file)
    assert detections_bytes(reversed(rows)) == detections_bytes(rows)


def test_a_bad_table_of_poses_is_refused_line_by_line(tmp_path):
    path = tmp_path / "poses.csv"
    content = detections_bytes([Detection("a.png", "", 133, (1.0,) * len(NUMBERS)), Detection("b.png", "no dots")])
    good = content.decode().splitlines()
    bad = ["c.png,x," + "1," * len(NUMBERS) + ",", "d.png,3", good[1].replace("1.0", "nan")]
    path.write_text("\n".join([*good, *bad]))
    with pytest.raises(InputError) as caught:
        load_detections(path)
    assert [problem.line for problem in caught.value.problems] == [4, 5, 6]
    path.write_text("pose,run\n")
    with pytest.raises(InputError, match="is not a table of poses"):
        load_detections(path)
    with pytest.raises(InputError, match="cannot be read"):
        load_detections(tmp_path / "absent.csv")


def test_readings_round_trip_and_join(tmp_path):
    table = simulate_study(seed=2, runs=2, validation_runs=1, random_poses=2, images=2).calibration
    readings = readings_of(table)
    path = tmp_path / "readings.csv"
    path.write_bytes(readings_bytes(readings))
    again = load_readings(path)
    assert again.keys() == readings.keys()
    assert all(np.array_equal(again[key], readings[key]) for key in readings)
    values = np.concatenate([table.position, table.quaternion, np.ones((len(table), len(NUMBERS) - 7))], axis=1)
    rows = [
        Detection(f"shots/{name}.png", "", 9, tuple(map(float, row)))
        for name, row in zip(table.row_ids, values, strict=True)
    ]
    assert study_table(rows, again) == table
    rows[3] = Detection(rows[3].file, "no dots")
    assert study_table(rows, again).row_ids == [name for k, name in enumerate(table.row_ids) if k != 3]
    with pytest.raises(InputError, match="no leg readings are given for pose 'x'"):
        study_table([Detection("x/1/1.png", "", 9, rows[0].values)], again)
    with pytest.raises(InputError, match="none shows the target"):
        study_table([Detection("e00/1/1.png", "no dots")], again)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "is empty"),
        ("pose,run\na,1\n", "'L1' is missing"),
        ("pose,run,L1,L3\na,1,2,3\n", "unknown column 'L3'"),
        ("pose,run,L1\na,1,x\n", "not a number"),
        ("pose,run,L1\na,1,1\na,1,2\n", "given on line 2 already"),
    ],
)
def test_bad_readings_are_refused(tmp_path, text, where):
    path = tmp_path / "readings.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=where):
        load_readings(path)
