"""Logs are read whatever their separators, headers and comments; no spreadsheet runs a name that we write."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.common.documents import guarded, unguarded
from cpcal.common.errors import InputError
from cpcal.files import load_campaign, read_log, save_campaign
from cpcal.robot import DELTALAB, Campaign

numbers = st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: round(x, 6))


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "log.txt"
    path.write_bytes(text.encode(encoding))
    return path


@given(
    st.lists(st.lists(numbers, min_size=5, max_size=5), min_size=2, max_size=6),
    st.sampled_from(",;\t "),
    st.sampled_from(".,"),
)
def test_separator_and_decimal_sign_are_guessed(tmp_path_factory, table, separator, sign):
    if (separator, sign) == (",", ","):
        return
    rows = [[f"{value:.6f}".replace(".", sign) for value in row] for row in table]
    lines = [separator.join(row) for row in [["Tx", "Ty", "Tz", "S1", "S2"], *rows]]
    path = tmp_path_factory.mktemp("log") / "log.txt"
    path.write_text("Tracker v1\n\n" + "\n".join(lines) + "\n", encoding="utf-8")
    log = read_log(path)
    assert log.header == ("Tx", "Ty", "Tz", "S1", "S2")
    assert [list(row) for row in log.rows] == rows
    assert log.decimal == sign
    assert log.lines[0] == 4


def test_comments_units_and_other_encodings(tmp_path):
    text = "% Müller\n#Frame\tX\tY\tZ\n[-]\t[mm]\t[mm]\t[mm]\n1\t0.5\t1\t2\n# pause\n\n2\t0.6\t1\t-2e-3\n"
    for encoding in ("utf-8", "latin-1", "utf-16"):
        log = read_log(written(tmp_path, text, encoding))
        assert log.header == ("Frame", "X", "Y", "Z")
        assert log.lines == (4, 7)
        assert log.rows[1] == ("2", "0.6", "1", "-2e-3")


def test_quoted_cells_hold_separators(tmp_path):
    log = read_log(written(tmp_path, '"Tz, up",b,c,d\n1,2,3,"a, b"\n'))
    assert log.header == ("Tz, up", "b", "c", "d")
    assert log.rows == (("1", "2", "3", "a, b"),)


def test_rows_of_another_length_are_refused_by_line(tmp_path):
    with pytest.raises(InputError) as caught:
        read_log(written(tmp_path, "a,b,c\n1,2,3\n4,5\n6,7,8\nend of file\n"))
    assert [problem.line for problem in caught.value.problems] == [3, 5]


@pytest.mark.parametrize("text", ["", "nothing here\nat all\n", "1,2\n3,4\n"])
def test_what_holds_no_measurements_is_refused(tmp_path, text):
    with pytest.raises(InputError, match="holds no rows of numbers"):
        read_log(written(tmp_path, text))


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
