"""The page in a real browser: quiet, self-contained, within the width of a phone, in both themes, on paper.

To start the browser is what takes long: what it says, asks for and measures of a page is of one start.
"""

import html
import json
import re
import shutil
import subprocess
from typing import Any, NamedTuple

import numpy as np
import pytest
from matplotlib.image import imread

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no `chromium` on PATH (Debian: apt install chromium)")

SMALL, PHONE, DESK, PAPER = 360, 390, 1000, 700  # CSS pixels

# Opens the page in frames (its own policy forbids scripts), and writes what it measures into its own document.
_MEASURE = """<!doctype html><meta charset="utf-8"><pre id="out"></pre><script>
const found = {};
function measure(frame) {
  const page = frame.contentDocument, root = page.documentElement, width = root.clientWidth;
  page.querySelectorAll("details").forEach((d) => { d.open = true; });
  const shown = (e) => e.textContent.trim() || e.tagName;
  const wide = [...page.querySelectorAll("body *")]
    .filter((e) => !e.closest(".scroll > *") && e.getBoundingClientRect().right > width + 0.5).map(shown);
  const overlaps = [], cut = [];
  const walker = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  const boxes = [];  // a text, the box of one of its lines without the room above and below the letters, its node
  while (walker.nextNode()) {
    const node = walker.currentNode, text = node.data.trim(), range = page.createRange();
    if (!text || node.parentElement.closest("style, script, title")) continue;
    range.selectNodeContents(node);
    for (const r of range.getClientRects()) {
      const h = 0.15 * r.height;
      boxes.push([text, {left: r.left, right: r.right, top: r.top + h, bottom: r.bottom - h}, node]);
    }
    const svg = node.parentElement.closest("svg"), edge = svg ? svg.getBoundingClientRect() : {left: 0, right: width};
    const last = range.getBoundingClientRect();
    if (!svg && node.parentElement.closest(".scroll")) continue;
    if (last.left < edge.left - 1 || last.right > edge.right + 1) cut.push(text);
  }
  boxes.forEach(([a, p, m], i) => boxes.slice(0, i).forEach(([b, q, n]) => {
    if (m !== n && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 0.5 &&
        Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 0.5) overlaps.push([a, b]);
  }));
  const texts = boxes.length, scroll = root.scrollWidth;
  found[frame.width] = {width: width, scroll: scroll, wide: wide, overlaps: overlaps, cut: cut, texts: texts};
  document.getElementById("out").textContent = JSON.stringify(found);
}
</script>
"""
_FRAME = '<iframe width="{width}" height="800" style="border:0" src="{name}.html" onload="measure(this)"></iframe>\n'


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


def console(outcome):
    """What the page said on the console."""
    return [line for line in outcome.stderr.splitlines() if "CONSOLE" in line]


class Look(NamedTuple):
    """What the page said; URLs that it asked for over a network; what the script above found at each width."""

    console: list[str]
    requests: set[str]
    found: dict[int, dict[str, Any]]


def looked(folder, page, *widths):
    """A page in frames of these widths. As wide as PAPER it is printed: its rules for print applied to a screen, which
    alone can be measured."""
    text = page.read_text(encoding="utf-8")
    (folder / "page.html").write_text(text, encoding="utf-8")
    (folder / "paper.html").write_text(text.replace("@media print", "@media all"), encoding="utf-8")
    frames = (_FRAME.format(width=width, name="paper" if width == PAPER else "page") for width in widths)
    wrapper, log = folder / "wrapper.html", folder / "net.json"
    wrapper.write_text(_MEASURE + "".join(frames), encoding="utf-8")
    options = ("--allow-file-access-from-files", f"--log-net-log={log}", "--dump-dom")
    outcome = chromium(folder, *options, wrapper.as_uri())
    found = re.search(r'<pre id="out">(.*?)</pre>', outcome.stdout, re.DOTALL)
    assert found is not None
    events = [event.get("params", {}) for event in json.loads(log.read_text(encoding="utf-8"))["events"]]
    return Look(
        console(outcome),
        # what the browser asks for itself has no origin
        {p["url"] for p in events if "url" in p and p.get("initiator", "not an origin") != "not an origin"},
        {int(width): of for width, of in json.loads(html.unescape(found[1])).items()},
    )


def screenshot(folder, page, *options):
    file = folder / "shot.png"
    assert (
        console(chromium(folder, f"--window-size={DESK},1400", f"--screenshot={file}", *options, page.as_uri())) == []
    )
    return imread(file)[..., :3]


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    """What the checks have to find: a request, a message, a wide element, texts that overlap."""
    folder = tmp_path_factory.mktemp("bad")
    file = folder / "bad.html"
    file.write_text(
        '<!doctype html><body style="margin:0"><p style="width:600px; margin:0">wide</p>'
        '<p style="position:absolute; margin:0; top:0; left:0">over</p><p style="position:absolute; left:600px">far</p>'
        '<img src="http://cpcal.test/x.png"><script>console.error("boo")</script>'
        '<svg viewBox="0 0 9 9"><text y="5">a</text><text y="5">b</text></svg>',
        encoding="utf-8",
    )
    return looked(folder, file, PHONE)


@pytest.fixture(scope="module")
def seen(page, tmp_path_factory):
    return looked(tmp_path_factory.mktemp("seen"), page, SMALL, PHONE, DESK, PAPER)


@pytest.fixture(scope="module")
def study_seen(study_page, tmp_path_factory):
    return looked(tmp_path_factory.mktemp("study"), study_page, SMALL, PHONE, DESK, PAPER)


def test_it_says_nothing_on_the_console(seen, bad):
    assert seen.console == []
    assert any("boo" in line for line in bad.console)


def test_no_request_leaves_the_page(seen, bad):
    assert seen.requests == set()
    assert bad.requests == {"http://cpcal.test/x.png"}


def fits(found, *widths, texts=500):
    for width in widths:
        assert found[width]["texts"] > texts
        sound = {"width": width, "scroll": width, "wide": [], "overlaps": [], "cut": []}
        assert found[width] == {**found[width], **sound}


def test_it_fits_a_phone_and_no_text_overlaps(seen, bad):
    fits(seen.found, SMALL, PHONE, DESK)
    control = bad.found[PHONE]
    assert control["scroll"] > PHONE
    assert "wide" in control["wide"]
    assert ["b", "a"] in control["overlaps"]
    assert ["over", "wide"] in control["overlaps"]
    assert "far" in control["cut"]


def test_a_study_is_quiet_and_fits_a_phone(study_seen):
    assert study_seen.console == []
    assert study_seen.requests == set()
    fits(study_seen.found, SMALL, PHONE, DESK)


def test_no_text_of_a_study_overlaps_on_paper(study_seen):
    fits(study_seen.found, PAPER)


def test_no_text_overlaps_on_paper(page, seen):
    assert page.read_text(encoding="utf-8").count("@media print") == 1
    fits(seen.found, PAPER)


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
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 8  # at most two a leg


def test_a_study_prints_on_eight_sheets(study_page, tmp_path):
    paper = tmp_path / "page.pdf"
    chromium(tmp_path, f"--print-to-pdf={paper}", study_page.as_uri())
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes())) <= 8


def test_the_page_of_a_comparison(comparison, tmp_path):
    seen = looked(tmp_path, comparison, SMALL, PHONE, DESK)
    assert (seen.console, seen.requests) == ([], set())
    fits(seen.found, SMALL, PHONE, DESK, texts=60)
    light = screenshot(tmp_path, comparison, "--blink-settings=preferredColorScheme=1")
    dark = screenshot(tmp_path, comparison, "--blink-settings=preferredColorScheme=0")
    assert light[5, 5].min() > 0.95
    assert dark[5, 5].max() < 0.2
