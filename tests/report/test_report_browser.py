"""The page in a real browser: quiet, self-contained, within the width of a phone, in both themes, on paper."""

import dataclasses
import html
import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.image import imread

import cpcal
from cpcal.calibration import PARAMETERS
from cpcal.report import write_page

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no `chromium` on PATH (Debian: apt install chromium)")

PHONE, DESK = 390, 1000  # CSS pixels

# Opens the page in frames (its own policy forbids scripts), and writes what it measures into its own document.
_MEASURE = """<!doctype html><meta charset="utf-8"><pre id="out"></pre><script>
const found = {};
function measure(frame) {
  const page = frame.contentDocument, root = page.documentElement, width = root.clientWidth;
  page.querySelectorAll("details").forEach((d) => { d.open = true; });
  const shown = (e) => e.textContent.trim() || e.tagName;
  const wide = [...page.querySelectorAll("body *")]
    .filter((e) => !e.closest(".scroll > *") && e.getBoundingClientRect().right > width + 0.5).map(shown);
  const overlaps = [];
  let texts = 0;
  for (const svg of page.querySelectorAll("svg")) {
    const boxes = [...svg.querySelectorAll("text")].map((t) => [t.textContent, t.getBoundingClientRect()]);
    texts += boxes.length;
    boxes.forEach(([a, p], i) => boxes.slice(0, i).forEach(([b, q]) => {
      if (Math.min(p.right, q.right) - Math.max(p.left, q.left) > 0.5 &&
          Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 0.5) overlaps.push([a, b]);
    }));
    const view = svg.getBoundingClientRect();
    boxes.filter(([a, p]) => p.left < view.left - 1 || p.right > view.right + 1)
      .forEach(([a, p]) => overlaps.push([a, "edge"]));
  }
  found[frame.width] = {width: width, scroll: root.scrollWidth, wide: wide, overlaps: overlaps, texts: texts};
  document.getElementById("out").textContent = JSON.stringify(found);
}
</script>
"""
_FRAME = '<iframe width="{width}" height="800" style="border:0" src="page.html" onload="measure(this)"></iframe>\n'


def chromium(folder, *arguments):
    """Run it headless with a profile of its own and without a network; what it printed."""
    assert CHROMIUM is not None
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    options += ["--disable-component-update", "--disable-sync", "--hide-scrollbars", "--enable-logging=stderr"]
    options += [f"--user-data-dir={folder / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND"]
    outcome = subprocess.run(
        [CHROMIUM, *options, "--virtual-time-budget=5000", *arguments],
        capture_output=True,
        encoding="utf-8",
        timeout=60,
        check=False,
    )
    assert outcome.returncode == 0, outcome.stderr
    return outcome


def console(folder, page):
    """What the page says on the console."""
    printed = chromium(folder, "--dump-dom", page.as_uri()).stderr
    return [line for line in printed.splitlines() if "CONSOLE" in line]


def requests(folder, page):
    """URLs that the page asks for over a network; those that the browser asks for itself have no origin."""
    log = folder / "net.json"
    chromium(folder, f"--log-net-log={log}", "--dump-dom", page.as_uri())
    events = [event.get("params", {}) for event in json.loads(log.read_text(encoding="utf-8"))["events"]]
    return {p["url"] for p in events if "url" in p and p.get("initiator", "not an origin") != "not an origin"}


def measured(folder, page, *widths):
    """What the script above finds at each width."""
    shutil.copyfile(page, folder / "page.html")
    wrapper = folder / "wrapper.html"
    wrapper.write_text(_MEASURE + "".join(_FRAME.format(width=width) for width in widths), encoding="utf-8")
    dom = chromium(folder, "--allow-file-access-from-files", "--dump-dom", wrapper.as_uri()).stdout
    found = re.search(r'<pre id="out">(.*?)</pre>', dom, re.DOTALL)
    assert found is not None
    return {int(width): of for width, of in json.loads(html.unescape(found.group(1))).items()}


def screenshot(folder, page, *options):
    file = folder / "shot.png"
    chromium(folder, f"--window-size={DESK},1400", f"--screenshot={file}", *options, page.as_uri())
    return imread(file)[..., :3]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Six legs of every kind: proved, thin, wide, unbounded, empty, without a point; with long names."""
    campaign = cpcal.simulate(seed=1, joint_error=1.0)
    long = "Supercalifragilistic" * 8
    campaign = dataclasses.replace(
        campaign, robot=dataclasses.replace(campaign.robot, name=f"<b>{long}"), provenance={long: long}
    )
    nominal = campaign.robot.parameters

    def leg(number, reach, **changes):
        x = nominal[number - 1]
        box = cpcal.Box(PARAMETERS, x - reach, x + reach)
        point, ids = tuple(map(float, x)), tuple(campaign.measurement_ids)
        fields = ("Both bounds are proved.", 0.089, 0.0890001, point, tuple(x + 1.5), box, 0.0, ids, 1, 94, 0.25)
        return dataclasses.replace(cpcal.LegResult(number, cpcal.Verdict.PROVED, *fields), **changes)

    legs = (
        leg(1, 1e-7),
        leg(2, 4.0),
        leg(3, np.array([np.inf, 1.0, 2e3, 1.0, 1.0, 1.0, 1e9])),
        leg(4, 1.0, enclosure=cpcal.Box.empty(PARAMETERS), verdict=cpcal.Verdict.REFUTED, point=None),
        leg(5, 100.0, verdict=cpcal.Verdict.UNKNOWN, point=None, eps_hi=math.inf),
        leg(6, 0.0),
    )
    asked = (PARAMETERS, 100.0, "fit", 1e-6, None, ("lifted",), "float64", "0.1.0")
    result = cpcal.Result(campaign.robot.name, campaign.sha256, len(campaign), *asked, legs)
    return write_page(campaign, result, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture
def bad(tmp_path):
    """What the checks have to find: a request, a message, a wide element, texts that overlap."""
    file = tmp_path / "bad.html"
    file.write_text(
        '<!doctype html><img src="http://cpcal.test/x.png"><script>console.error("boo")</script>'
        '<p style="width:600px">wide</p><svg viewBox="0 0 9 9"><text y="5">a</text><text y="5">b</text></svg>',
        encoding="utf-8",
    )
    return file


def test_it_says_nothing_on_the_console(page, bad, tmp_path):
    assert console(tmp_path, page) == []
    assert any("boo" in line for line in console(tmp_path, bad))


def test_no_request_leaves_the_page(page, bad, tmp_path):
    assert requests(tmp_path, page) == set()
    assert requests(tmp_path, bad) == {"http://cpcal.test/x.png"}


def test_it_fits_a_phone_and_no_text_overlaps(page, bad, tmp_path):
    found = measured(tmp_path, page, PHONE, DESK)
    for width in (PHONE, DESK):
        assert found[width]["texts"] > 100
        assert found[width] == {**found[width], "width": width, "scroll": width, "wide": [], "overlaps": []}
    control = measured(tmp_path, bad, PHONE)[PHONE]
    assert control["scroll"] > PHONE
    assert "wide" in control["wide"]
    assert ["b", "a"] in control["overlaps"]


def test_both_themes(page, tmp_path):
    light = screenshot(tmp_path, page, "--blink-settings=preferredColorScheme=1")
    dark = screenshot(tmp_path, page, "--blink-settings=preferredColorScheme=0")
    assert light.shape == dark.shape == (1400, DESK, 3)
    assert light[5, 5].min() > 0.95
    assert dark[5, 5].max() < 0.2
    for shot in (light, dark):  # something is to be seen: text stands out from its paper
        assert np.ptp(shot.mean(axis=2)) > 0.7


def test_it_prints(page, tmp_path):
    paper = tmp_path / "page.pdf"
    chromium(tmp_path, f"--print-to-pdf={paper}", page.as_uri())
    content = paper.read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", content)) >= 7  # each leg begins a page
