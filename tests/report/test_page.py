"""The page and its figures: valid, self-contained, hostile names do nothing, small for large campaigns."""

import dataclasses
import io
import math
import re
import shlex
from html.parser import HTMLParser

import pytest
from rich.console import Console
from tinyhtml5.parser import HTMLParser as Html5
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.cli.certify import show_result
from cpcal.cli.verbs import Talk
from cpcal.common.codec import encoded
from cpcal.files import campaign_sha256
from cpcal.models import PARAMETERS, PLAIN
from cpcal.report import QUANTIFIER, errors_svg, write_report
from cpcal.report.figures import FARTHEST
from cpcal.report.run_page import REPORT_NAME, command, render
from tests.changed import leg_with
from tests.report.made import made_leg, made_result

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&\x1b[31m"


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=1, joint_error=1.0)


def leg_result(campaign, leg=1, **changes):
    """A plausible answer without running the solver: the nominal point and an eps of its own."""
    x = campaign.robot.parameters[leg - 1]
    point, enclosure = tuple(map(float, x)), cpcal.Box(PARAMETERS, x - 1e-3, x + 1e-3)
    support = tuple(campaign.measurement_ids[::9])
    numbers = (0.0890117468, 0.0890117515, point, point, enclosure, 0.0, support, 1, 94, 0.25)
    return made_leg(leg, *numbers, **changes)


def result_of(campaign, *legs, **changes):
    return made_result(campaign, *(legs or (leg_result(campaign),)), **changes)


class _Reader(HTMLParser):
    """Collects tags with their attributes, and ids."""

    def __init__(self):
        super().__init__()
        self.seen, self.ids = [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        self.ids += [value for name, value in attrs if name == "id"]


def harmless(page):
    """Loads nothing and runs nothing."""
    reader = _Reader()
    reader.feed(page)
    assert parse_errors(page) == []
    tags = {tag for tag, _ in reader.seen}
    assert not tags & {"script", "link", "img", "iframe", "object", "embed", "image", "base", "form"}
    for _, attributes in reader.seen:
        assert not any(name.startswith("on") or name in ("src", "srcset") for name in attributes)
        for name in ("href", "xlink:href"):
            assert attributes.get(name, "#").startswith("#")
    assert "http:" not in page
    assert "https:" not in page
    assert "@import" not in page
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", page))
    return reader


def test_it_is_self_contained_and_says_what_matters(campaign, tmp_path):
    legs = (leg_result(campaign), leg_result(campaign, 2))
    path = write_report(campaign, result_of(campaign, *legs), tmp_path / "new" / "run")
    assert path == tmp_path / "new" / "run" / REPORT_NAME
    assert [p.name for p in path.parent.iterdir()] == [REPORT_NAME]
    page = path.read_text(encoding="utf-8")
    reader = harmless(page)
    assert len(reader.ids) == len(set(reader.ids))
    references = set(re.findall(r'href="#([^"]+)"', page)) | set(re.findall(r"url\(#([^)]+)\)", page))
    assert references <= set(reader.ids)
    for text in (
        "0.08901174",
        "0.08901176",
        campaign_sha256(campaign),
        QUANTIFIER,
        "longer than eps",
        "proved",
        "±100 mm",
    ):
        assert text in page
    assert page.count('role="img"') == 3  # one of all legs, and one a leg
    assert "#0102" not in page  # every colour is the page's


def test_hostile_names_do_nothing(campaign):
    printable = HOSTILE[:-5]
    robot = dataclasses.replace(campaign.robot, name=printable)
    pose = tuple(f"{printable.replace('/', '')}{k}" for k in range(len(campaign)))
    hostile = dataclasses.replace(campaign, robot=robot, pose=pose, provenance={printable: printable + "}}{% raw %}"})
    leg = leg_result(hostile, support=tuple(hostile.measurement_ids[:3]))
    page = render(hostile, result_of(hostile, leg, version=HOSTILE, contractors=[HOSTILE]))
    harmless(page)
    assert "&lt;script&gt;" in page
    assert "\x1b" not in page


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"verdict": cpcal.Verdict.UNKNOWN, "eps_hi": math.inf, "point": None}, "fails below"),
        ({"enclosure": cpcal.Box(PARAMETERS, [-math.inf] * 7, [math.inf] * 7)}, "-∞"),
        (
            {
                "verdict": cpcal.Verdict.REFUTED,
                "eps_lo": math.inf,
                "eps_hi": math.inf,
                "point": None,
                "enclosure": cpcal.Box.empty(PARAMETERS),
                "support": (),
            },
            "nothing to enclose",
        ),
        ({"eps_lo": 0.0, "eps_hi": 0.0}, "fits within the stated reading uncertainty (for some readings): proved"),
    ],
)
def test_results_without_a_point_or_bounds(campaign, changes, text):
    page = render(campaign, result_of(campaign, leg_result(campaign, **changes)))
    harmless(page)
    assert text in page
    assert "residuals over the measurements" in page  # of the recommended parameters


def test_a_result_of_another_campaign_is_refused(campaign, tmp_path):
    other = cpcal.simulate(seed=2)
    with pytest.raises(cpcal.InputError, match="another campaign"):
        write_report(other, result_of(campaign), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_unproved_robot_wears_no_badge_that_says_proved(campaign):
    page = render(campaign, result_of(campaign))
    badges = re.findall(r'class="verdict (\w+)"[^>]*>([^<]*)<', page)
    assert badges[0] == ("bounded", "fits to within 0.08901176 mm")
    assert not re.search(r'class="verdict[^>]*>proved', page)


def test_one_number_has_one_rounding(campaign):
    """On the page and in the terminal: each text that begins like a bound is that bound's only text."""
    result = result_of(campaign)
    printed = io.StringIO()
    console = Console(file=printed, width=200)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Talk, "console", lambda *_, **__: console)
        for verbose in (True, False):
            show_result(Talk(verbose=verbose), campaign, result, PLAIN)
    for text in (render(campaign, result), printed.getvalue()):
        assert set(re.findall(r"\b0\.0890\d*", text)) == {"0.08901174", "0.08901176"}


def parse_errors(text):
    parser = Html5()
    parser.parse(text)
    return parser.errors


def test_every_page_parses_without_an_error(page, comparison):  # that of a study is parsed with hostile names
    for file in (page, comparison):
        assert parse_errors(file.read_text(encoding="utf-8")) == []
    for wrong in ("<p>no doctype", "<!doctype html><table><p></table>", "<!doctype html>&nosuchthing;"):
        assert parse_errors(wrong) != []


def test_an_interrupted_run_says_so(campaign):
    page = render(campaign, result_of(campaign, interrupted=True))
    assert "Interrupted" in page
    assert "2, 3, 4, 5, 6" in page
    empty = dataclasses.replace(result_of(campaign, interrupted=True), legs=())
    assert "No leg was finished" in render(campaign, empty)


@pytest.fixture(scope="module")
def few_poses():
    return cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=14)


@pytest.mark.parametrize(
    "asked",
    [
        {"legs": [2], "eps": 0.1, "model": "gain", "tolerance": 0.5, "time_limit": 60.0, "support": "none"},
        {"legs": [3], "delta": 12.5, "center": "nominal", "gap": 1e-3, "contractors": ("hc4", "lifted")},
    ],
)
def test_the_command_repeats_the_run(few_poses, tmp_path, asked):
    result = cpcal.certify(few_poses, certificates=tmp_path / "ours", ranges=True, **asked)  # as the command does
    cpcal.save_campaign(few_poses, tmp_path / "c")
    places = {"CAMPAIGN": str(tmp_path / "c"), "RUN": str(tmp_path / "run")}
    words = [places.get(word, word) for word in shlex.split(command(result))]
    assert words.pop(0) == "cpcal"
    assert CliRunner().invoke(app, words, prog_name="cpcal").exit_code in (0, 1)
    again = cpcal.load_result(tmp_path / "run")

    def answers(found):  # without what differs from run to run, and the names of files
        return [encoded(leg_with(leg, seconds=0.0, ranges=None)) for leg in found.legs]

    assert answers(again) == answers(result)
    assert dataclasses.replace(again, legs=()) == dataclasses.replace(result, legs=())


def marks(svg, variable):
    """Ticks, arrows and crosses (two lines each) of that colour."""
    paths = re.findall(rf'<path d="([^"Z]*)" style="fill: none; stroke: var\(--{variable}\)', svg)
    return sum(path.count("M") for path in paths)


@pytest.mark.parametrize(
    ("lo", "hi", "ticks_and_arrows", "crosses"),
    [
        (1.0, 1.0 + 2.0**-30, 2, 1),  # so thin that only its ticks are seen
        (0.1, math.inf, 2, 0),  # a tick and an arrow
        (math.inf, math.inf, 1, 0),  # nothing fits
        (0.1, 2.0 * FARTHEST, 2, 0),
    ],
)
def test_a_bar_has_ticks_at_its_ends_an_arrow_to_what_is_too_far_and_a_cross_in_view(
    campaign, lo, hi, ticks_and_arrows, crosses
):
    point = None if hi == math.inf else (0.0,) * 7
    svg = errors_svg(result_of(campaign, leg_result(campaign, eps_lo=lo, eps_hi=hi, point=point)))
    assert "nan" not in svg.lower()
    ends = sum(marks(svg, kind) for kind in ("known", "open", "bad"))
    assert (ends, marks(svg, "support")) == (ticks_and_arrows, 2 * crosses)


def test_a_figure_is_a_document_of_its_own_in_colours_that_a_viewer_knows(campaign):
    legs = leg_result(campaign), leg_result(campaign, 2, eps_hi=math.inf, point=None)
    svg = errors_svg(result_of(campaign, *legs, tolerance=0.3))
    assert ">leg 2</text>" in svg
    assert "tolerance 0.3 mm" in svg
    text = svg._repr_svg_()
    assert text.startswith('<svg xmlns="http://www.w3.org/2000/svg" ')
    assert "var(--" not in text
    assert "#17693a" in text
