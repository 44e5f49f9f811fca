"""Unusable campaign files: every problem at once, with file, line and remedy, fast and in bounded memory."""

import time
import tracemalloc

import pytest

from cpcal.common.errors import InputError
from cpcal.files import load_campaign
from cpcal.files.tables import ROWS_MAX
from tests.files.two_legs import CSV, TOML, UNCERTAINTY, load, refused

HOPELESS = 60.0  # seconds: no measure of speed, but what only a time that grows with the square of the input exceeds


@pytest.mark.parametrize(
    ("old", "new", "line", "what", "remedy"),
    [
        ('format = "cpcal-campaign/1"\n', "", None, "'format' is missing", 'format = "cpcal-campaign/1"'),
        ("campaign/1", "campaign/2", 1, "the format is 'cpcal-campaign/2'", "reads"),
        ("[robot]", "[robt]", 2, "unknown key 'robt'", "did you mean 'robot'"),
        ("offset =", "ofset =", 9, "unknown key 'ofset' in [robot]", "did you mean 'offset'"),
        ('name = "two legs"\n', "", 2, "the key 'name' is missing", "add name"),
        ('"two legs"', "3", 3, "name is 3, not text", "quotes"),
        ("    [1.0, 2.0, 3.0],\n", "", 7, "mobile has 2 rows for 1 legs", "one row for each leg"),
        ("[1.0, 2.0, 3.0]", "[1.0, 2.0]", 4, "base of leg 2 has 2 numbers, not 3", "x, y and z"),
        ("[1.0, 2.0, 3.0]", '[1.0, "2.0", 3.0]', 4, "base of leg 2 holds '2.0'", "unquoted"),
        ("[1.0, 2.0, 3.0]", "[1.0, nan, 3.0]", 4, "base of leg 2 holds nan", "finite"),
        ("[5.0, 6.0]", "[5.0]", 9, "offset has 1 numbers, not 2", "one for each leg"),
        ("[5.0, 6.0]", "[5.0, 1" + "0" * 400 + "]", 9, "offset holds 1000", "finite"),
        ("factor = 3.0", "factor = -3.0", 12, "factor holds the negative number -3", ">= 0"),
        ("factor = 3.0\n", "", 11, "the key 'factor' is missing", "add factor"),
        (UNCERTAINTY, "", None, "the section [uncertainty] is missing", "exact = true"),
        ("[uncertainty]", "[uncertanty]", 11, "unknown key 'uncertanty'", "did you mean 'uncertainty'"),
        (UNCERTAINTY, "[uncertainty]\nexact = 1\n", 12, "exact is 1", "exact = true"),
        (UNCERTAINTY, "[uncertainty]\nexact = false\n", 12, "exact is False", "either factor = 3 with position_sigma"),
        ("factor = 3.0", "factor = 3.0\nexact = true", 13, "'exact' is given beside 'factor'", "either"),
        ("factor = 3.0", 'factor = "3.0"', 12, "factor holds '3.0', which is not a number", "unquoted"),
        ("[5.0, 6.0]", "[5.0, 1e13]", 9, "offset holds 10000000000000.0", "up to 1e+12"),
        ('"two legs"', '"two\\nlegs"', 3, "name is 'two\\nlegs'", "printable"),
        ('"two legs"', '"' + "x" * 201 + '"', 3, "name is 'xxx", "at most 200"),
        ("where =", '"wh\\nere" =', 17, "'wh\\nere' in [provenance] cannot be a name", "printable"),
        ('"here"', '"""he\nre"""', 18, "'where' in [provenance] is 'he\\nre'", "on one line"),
        ("[provenance]", '[model]\nname = "' + "g" * 201 + '"\n[provenance]', 18, "cannot be a name", "gain"),
        ("[1e-4, 1e-4, 1e-4]", "[1e-4, -1e-4, 1e-4]", 14, "rotation_sigma holds the negative", ">= 0"),
        ("[0.01, 0.02]", "[0.01]", 15, "length_sigma has 1 numbers, not 2", "one for each leg"),
        ("[0.01, 0.02]", "[0.01, 1e12]", 11, "factor * sigma is above", "smaller"),
        ("factor = 3.0", "length_half_width = [1, 1]", 12, "'length_half_width' is given beside 'factor'", "either"),
        ('where = "here"', "where = [1]", 18, "'where' in [provenance] is not a text", "text"),
        ("offset = [5.0, 6.0]", "offset = [5.0 6.0]", 9, "is not TOML", "correct"),
    ],
)
def test_a_bad_campaign_toml(tmp_path, old, new, line, what, remedy):
    assert TOML.count(old) >= 1
    found = refused(tmp_path, toml=TOML.replace(old, new, 1))
    assert [row for row in found if row[:2] == ("campaign.toml", line) and what in row[2] and remedy in row[3]]
    assert not [row for row in found if row[0] == "measurements.csv" and "leg" not in row[3]]


@pytest.mark.parametrize(
    ("line", "row", "what", "remedy"),
    [
        (3, "a,2,1,2,x3,0,1,0,0,10,11", "z: 'x3' is not a number", "number"),
        (3, "a,2,1,2,,0,1,0,0,10,11", "z is empty", "give a number"),
        (3, "a,2,1,2,1_0,0,1,0,0,10,11", "z: '1_0' is not a number", "digits"),
        (3, "a,2,nan,2,3,0,1,0,0,10,11", "x: 'nan' is not a number", "number"),
        (3, "a,2,1,2,3,0,1,0,0,10,1e155", "L2 is '1e155'", "up to 1e+12"),
        (3, "a,2,1,2,٣,0,1,0,0,10,11", "z: '٣' is not a number", "digits 0 to 9"),
        (3, "a\u202e,2,1,2,3,0,1,0,0,10,11", "'a\\u202e' cannot be the name", "printable"),
        (3, "a,2,1,2,3,1.000002,0,0,0,10,11", "the norm 1.000002, not 1", "divide"),
        (3, "a,2,1,2,3,0,0,0,0,10,11", "the quaternion is zero", "1,0,0,0"),
        (3, "a,1,1,2,3,0,1,0,0,10,11", "pose 'a' run '1' was given on line 2 already", "once"),
        (3, "a,2,1,2,3,0,1,0,0,10", "10 cells, but the header has 11", "one cell for each"),
        (3, "a,2/3,1,2,3,0,1,0,0,10,11", "'2/3' cannot be the name of a run", "/"),
        (3, 'a,"2,1,2,3,0,1,0,0,10,11', "the line is not CSV", "quotes"),
        (3, "a,2,1,2,3,0,\r1,0,0,10,11", "the line is not CSV", "line ends"),
        (3, b"a,2,1,2,3,0,\xff1,0,0,10,11", "not UTF-8", "UTF-8"),
        (3, b"a,2,1,2,3,0,\x001,0,0,10,11", "qx: '\\x001' is not a number", "number"),
        (4, "b,1," + "9" * 70_000, "longer than 65,536 bytes", "CSV"),
        (1, "pose,run,x,y,z,qw,qx,qy,qz,L1", "the column 'L2' is missing", "add a column L2"),
        (1, "pose,run,x,y,z,qw,qx,qy,qz,L1,L3", "unknown column 'L3'", "has 2 legs"),
        (1, "pose,run,x,y,z,qw,qx,qy,qz,L1,L1", "the column 'L1' is there twice", "take one"),
        (1, "pose;run;x;y;z;qw;qx;qy;qz;L1;L2", "separated by semicolons", "let `cpcal import` read the table"),
        (1, "a,1,1,2,3,1,0,0,0,10,11", "no header", "start with the line pose,run,x,"),
    ],
)
def test_a_bad_line_of_measurements(tmp_path, line, row, what, remedy):
    lines = CSV.encode().splitlines()
    lines[line - 1] = row if isinstance(row, bytes) else row.encode()
    found = refused(tmp_path, table=b"\n".join(lines))
    wanted = [r for r in found if r[:2] == ("measurements.csv", line) and what in r[2] and remedy in r[3]]
    assert wanted
    if line > 1:
        assert len(found) == 1


@pytest.mark.parametrize(("cell", "what"), [("-0.1", "dy: the half-width '-0.1' is negative"), ("x", "not a number")])
def test_bad_override_cells(tmp_path, cell, what):
    lines = CSV.splitlines()
    table = "\n".join([lines[0] + ",dy", lines[1] + ",", lines[2] + "," + cell, lines[3] + ",0"])
    ((_, line, said, _),) = refused(tmp_path, table=table)
    assert line == 3
    assert what in said


@pytest.mark.parametrize("table", [b"", b"\n \n\r\n", b"\xef\xbb\xbf"])
def test_empty_files(tmp_path, table):
    found = [row[:3] for row in refused(tmp_path, toml=table, table=table)]
    assert found == [("campaign.toml", 1, "is empty"), ("measurements.csv", 1, "is empty")]
    assert refused(tmp_path, table=CSV.splitlines()[0])[0][:3] == ("measurements.csv", 1, "holds no measurements")


def test_missing_files_and_folders(tmp_path):
    found = refused(tmp_path, toml=None, table=None)
    assert [row[::2] for row in found] == [(name, "does not exist") for name in ("campaign.toml", "measurements.csv")]
    (tmp_path / "file").write_text("")
    (tmp_path / "measurements.csv").mkdir()
    for folder, what in (("nowhere", "does not exist"), ("file", "not a folder"), ("", "cannot be read: Is a dir")):
        with pytest.raises(InputError, match=what):
            load_campaign(tmp_path / folder)


@pytest.mark.parametrize(
    "toml",
    [
        "x = " + "[" * 50_000, "x = " + "[" * 900 + "]" * 900, "x = " + "{a=" * 300 + "1" + "}" * 300,
        "x = " + "9" * 50_000, "[" + " " * 100_000, "a." * 500_000, "x" * 2**21, "\0",
    ],
    ids=["brackets", "closed brackets", "tables", "digits", "spaces", "dots", "large", "nul"],
)  # fmt: skip
def test_malicious_toml_ends(tmp_path, toml):
    start = time.perf_counter()
    assert len(refused(tmp_path, toml=toml)) == 1
    assert time.perf_counter() - start < HOPELESS


def test_everything_wrong_in_both_files_is_said_at_once(tmp_path):
    toml = TOML.replace("factor = 3.0", "factor = -1").replace('name = "two legs"', "nam = 1")
    table = CSV.replace("0.6,0.8", "0.6,0.9").replace("a,2,1,2,3", "a,2,one,nan,3")
    rows = [("measurements.csv", 3), ("measurements.csv", 3), ("measurements.csv", 4)]
    found = [row[:2] for row in refused(tmp_path, toml, table)]
    assert found == [*(("campaign.toml", line) for line in (3, 2, 12)), *rows]
    unusable = [row[:2] for row in refused(tmp_path, "rubbish", table)]  # rows are checked all the same
    assert unusable == [("campaign.toml", 1), *rows]


def test_fifty_problems_are_listed_and_the_others_counted(tmp_path):
    rows = [f"p{k},1,?,2,3,1,0,0,0,10,11" for k in range(300)]
    with pytest.raises(InputError) as caught:
        load(tmp_path, table="\n".join([CSV.splitlines()[0], *rows]))
    assert len(caught.value.problems) == 50
    assert caught.value.omitted == 250
    assert "300 problems" in str(caught.value)


@pytest.mark.parametrize(
    "row", ["rubbish", "a,1,x,y,z,qw,qx,qy,qz,L1,L2", "a,1,1,2,3,1,0,0,0,10,11", '"', "\xff", "\0", "q," * 3000]
)
def test_rubbish_without_end_is_given_up_soon(tmp_path, row):
    content = (CSV.splitlines()[0] + "\n").encode() + (row + "\n").encode("latin-1") * (
        200_000 if len(row) < 100 else 5_000
    )
    start = time.perf_counter()
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        load(tmp_path, table=content)
    assert tracemalloc.get_traced_memory()[1] < len(content) + 3e6  # this test's own copy, and little more
    tracemalloc.stop()
    assert time.perf_counter() - start < HOPELESS
    problems = caught.value.problems
    assert len(problems) == 51
    assert "1,000 bad rows: the rest of the file was not read" in problems[-1].what
    assert problems[-1].line in (1001, 1002)


def test_a_last_line_without_its_end_is_a_warning_that_names_it(tmp_path):
    """The file was cut inside its last number, and what is left is one, too."""
    load(tmp_path)
    table = tmp_path / "measurements.csv"
    table.write_text(CSV[:-2])
    with pytest.warns(
        UserWarning, match=r"measurements.csv:4: the last line has no line end; .* number, '1' ->"
    ) as caught:
        cut = load_campaign(tmp_path)
    assert len(caught) == 1
    assert cut.length[-1].tolist() == [10.0, 1.0]


def test_a_table_above_the_largest_number_of_rows_is_refused(tmp_path, monkeypatch):
    assert ROWS_MAX == 1_000_000
    monkeypatch.setattr("cpcal.files.tables.ROWS_MAX", 2)
    ((_, line, what, _),) = refused(tmp_path)
    assert (line, what) == (4, "holds more than 2 measurements: the rest of the file was not read")


def test_a_file_name_cannot_forge_a_line_of_output(tmp_path):
    folder = tmp_path / "x\nLeg 1: proved\x1b[31m\u202e"
    with pytest.raises(InputError) as caught:
        load_campaign(folder)
    assert len(str(caught.value).splitlines()) == 3  # what, and where to read on
    assert str(caught.value).replace("\n", "").isprintable()
    assert r"x\nLeg 1: proved\x1b[31m\u202e" in str(caught.value)
