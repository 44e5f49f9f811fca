"""The tables between images and a study: poses.csv and leg readings, written and read back."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.common.documents import unguarded
from cpcal.common.errors import InputError
from cpcal.files.tables import load_readings, readings_bytes
from cpcal.simulate import simulate_study
from cpcal.vision.batch.detect import COLUMNS, NUMBERS, Detection, detections_bytes
from cpcal.vision.batch.study_images import study_table

NAMES = st.lists(st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1), unique=True, max_size=6)
ROW = st.tuples(*[st.floats(-1e9, 1e9) for _ in NUMBERS])


@given(names=NAMES, data=st.data())
def test_a_table_of_poses_holds_every_detection_bit_for_bit(names, data):
    rows = []
    for name in names:
        reason = data.draw(st.sampled_from(["", "no dots", 'odd, "quoted"\nreason']))
        values = () if reason else data.draw(ROW)
        doubt = "" if reason else data.draw(st.sampled_from(["", 'large, "odd" residuals']))
        rows.append(Detection(name, reason, data.draw(st.integers(0, 200)), values, doubt))
    header, *lines = csv.reader(io.StringIO(detections_bytes(rows).decode("utf-8", "surrogateescape")))
    assert tuple(header) == COLUMNS
    read = [
        Detection(
            unguarded(file), unguarded(reason), int(dots), tuple(float(cell) for cell in cells if cell),
            unguarded(doubt),
        )
        for file, dots, *cells, doubt, reason in lines
    ]  # fmt: skip
    assert read == sorted(rows, key=lambda d: d.file)
    assert detections_bytes(reversed(rows)) == detections_bytes(rows)


def test_readings_round_trip_and_join(tmp_path):
    table = simulate_study(seed=2, runs=2, validation_runs=1, random_poses=2, images=2).calibration
    path = tmp_path / "readings.csv"
    path.write_bytes(readings_bytes(table))
    again = load_readings(path)
    assert again.keys() == set(zip(table.pose, table.run, strict=True))
    values = np.concatenate([table.position, table.quaternion, np.ones((len(table), len(NUMBERS) - 7))], axis=1)
    rows = [
        Detection(f"shots/{name}.png", "", 9, tuple(map(float, row)))
        for name, row in zip(table.row_ids, values, strict=True)
    ]
    assert study_table(rows, again) == replace(table, shared=np.ones((len(table), 6)))
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
