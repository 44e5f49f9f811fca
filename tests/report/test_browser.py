"""Pages in a real browser: quiet, self-contained, within the width of a phone, in both themes, on paper, self-checking.

To start the browser is what takes long: one start measures all pages at all widths, one all of them in dark colours.
"""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import cpcal
from cpcal.files import save_campaign_json
from cpcal.report.run_page import render

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no `chromium` on PATH (Debian: apt install chromium)")

PHONE, DESK, PAPER = 360, 1000, 700  # CSS pixels
SCREENS = (PHONE, DESK)

# Opens the pages in frames (their own policy forbids scripts), and writes what it measures into its own document.
_MEASURE = """<!doctype html><meta charset="utf-8"><pre id="out"></pre><script>
const found = {};
function measure(frame) {
  const page = frame.contentDocument, root = page.documentElement, width = root.clientWidth;
  const height = root.scrollHeight;
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
  boxes.sort(([, p], [, q]) => p.top - q.top);
  boxes.forEach(([a, p, m], i) => {
    for (let k = i + 1; k < boxes.length && boxes[k][1].top < p.bottom - 0.5; k++) {
      const [b, q, n] = boxes[k];
      if (m !== n && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 0.5 &&
          Math.min(p.bottom, q.bottom) - q.top > 0.5) overlaps.push([a, b].sort());
    }
  });
  const looks = getComputedStyle(page.body), texts = boxes.length, scroll = root.scrollWidth;
  found[frame.id] = {width, height, scroll, wide, overlaps, cut, texts, ink: looks.color, paper: looks.backgroundColor};
  document.getElementById("out").textContent = JSON.stringify(found);
}
</script>
"""
_FRAME = '<iframe id="{0}-{1}" width="{1}" height="800" style="border:0" src="{2}" onload="measure(this)"></iframe>\n'

# What the checks have to find: a request, a message, a wide element, texts that overlap.
_BAD = (
    '<!doctype html><body style="margin:0"><p style="width:600px; margin:0">wide</p>'
    '<p style="position:absolute; margin:0; top:0; left:0">over</p><p style="position:absolute; left:600px">far</p>'
    '<img src="http://cpcal.test/x.png"><script>console.error("boo")</script>'
    '<svg viewBox="0 0 9 9"><text y="5">a</text><text y="5">b</text></svg>'
)


def chromium(folder: Path, *arguments: object) -> Any:
    """Run it headless with a profile of its own and without a network."""
    assert CHROMIUM is not None
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    options += ["--disable-component-update", "--disable-sync", "--hide-scrollbars", "--enable-logging=stderr"]
    options += [f"--user-data-dir={folder / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND"]
    options += ["--allow-file-access-from-files", "--virtual-time-budget=5000"]
    command = [CHROMIUM, *options, *map(str, arguments)]
    outcome = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=120, check=False)
    assert outcome.returncode == 0, outcome.stderr
    return outcome


def opened(folder: Path, wrapper: str, *options: object) -> Any:
    """A page of scripts, and what it wrote about the pages in its frames, which lie beside it."""
    (folder / "wrapper.html").write_text(wrapper, encoding="utf-8")
    outcome = chromium(folder, *options, "--dump-dom", (folder / "wrapper.html").as_uri())
    written = re.search(r'<pre id="out">(.+?)</pre>', outcome.stdout, re.DOTALL)
    assert written is not None, "the page did not say what it found"
    return outcome, json.loads(html.unescape(written[1]))


class Look(NamedTuple):
    """What pages said, by the file; URLs that they asked for over a network; what was measured, by page and width."""

    console: list[str]
    requests: set[str]
    found: dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def folder(page, study_page, comparison, tmp_path_factory):
    """The pages; "paper" ones have their rules for print on a screen, which alone can be measured."""
    place = tmp_path_factory.mktemp("pages")
    for name, file in {"page": page, "study": study_page, "comparison": comparison}.items():
        text = file.read_text(encoding="utf-8")
        assert text.count("@media print") == 1
        (place / f"{name}.html").write_text(text, encoding="utf-8")
        (place / f"paper-{name}.html").write_text(text.replace("@media print", "@media all"), encoding="utf-8")
    (place / "bad.html").write_text(_BAD, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def seen(folder):
    frames = [(name, width, f"{name}.html") for name in ("page", "study", "comparison") for width in SCREENS]
    frames += [(name, PAPER, f"paper-{name}.html") for name in ("page", "study")] + [("bad", PHONE, "bad.html")]
    log = folder / "net.json"
    wrapper = _MEASURE + "".join(_FRAME.format(*frame) for frame in frames)
    outcome, found = opened(folder, wrapper, "--blink-settings=preferredColorScheme=1", f"--log-net-log={log}")
    events = [event.get("params", {}) for event in json.loads(log.read_text(encoding="utf-8"))["events"]]
    # what the browser asks for itself has no origin
    requests = {p["url"] for p in events if "url" in p and p.get("initiator", "not an origin") != "not an origin"}
    return Look([line for line in outcome.stderr.splitlines() if "CONSOLE" in line], requests, found)


def test_pages_say_nothing_on_the_console_and_ask_for_nothing(seen):
    (line,) = seen.console
    assert "boo" in line
    assert "bad.html" in line
    assert seen.requests == {"http://cpcal.test/x.png"}


@pytest.mark.parametrize(
    ("name", "widths", "texts"),
    [("page", (*SCREENS, PAPER), 300), ("study", (*SCREENS, PAPER), 500), ("comparison", SCREENS, 60)],
)
def test_a_page_fits_a_phone_and_no_text_overlaps_also_on_paper(seen, name, widths, texts):
    for width in widths:
        found = seen.found[f"{name}-{width}"]
        assert found["texts"] > texts
        assert found == found | {"width": width, "scroll": width, "wide": [], "overlaps": [], "cut": []}


# The page that checks itself: opened as it is it turns green, with an edited number red.

# The browser's clock runs ahead of the pages' workers, so each look first counts for a while; at most 600 looks.
_WATCH = """<!doctype html><meta charset="utf-8"><pre id="out"></pre><script>
let count = 0;
const ended = (frame) => {
  const page = frame.contentDocument, status = page && page.getElementById("proof-status");
  return status && /held|refuted/.test(status.className) ? [status, page] : null;
};
const wait = setInterval(() => {
  for (let k = 0; k < 2e7; k++) count += k % 2;
  const frames = [...document.getElementsByTagName("iframe")], all = frames.map(ended);
  if (!all.length || all.includes(null)) return;
  clearInterval(wait);
  document.getElementById("out").textContent = JSON.stringify(all.map(([status, page]) => [status.className,
    status.textContent, [...page.querySelectorAll("[data-claim].refuted")].map(e => e.textContent.trim())]));
}, 100);
</script>
"""
EDITS = (
    ("", ""),
    (r'data-claim="overall" data-value="[^"]+">', "PASS"),
    (r'data-claim="count">', "13"),
    (r'data-claim="eps_lo" data-value="[^"]+">', "0.123"),
)


def test_an_untouched_page_turns_green_and_an_edited_one_red_where_it_was_edited(tmp_path):
    run = tmp_path / "run"
    campaign = cpcal.simulate(seed=2, joint_error=10.0, factor=0.0, extremal=False, random_poses=12)
    result = cpcal.certify(campaign, legs=[1], delta=4.0, tolerance=0.01, certificates=run)
    save_campaign_json(campaign, run)
    text = render(campaign, result, run=run)
    for k, (mark, edited) in enumerate(EDITS):
        changed, times = re.subn(rf"({mark})[^<]+<", rf"\g<1>{edited}<", text, count=1) if mark else (text, 1)
        assert times == 1
        (tmp_path / f"{k}.html").write_text(changed, encoding="utf-8")
    frames = "".join(f'<iframe src="{k}.html"></iframe>' for k in range(len(EDITS)))
    _, (genuine, *others) = opened(tmp_path, _WATCH + frames, "--virtual-time-budget=60000")
    state, said, red = genuine
    assert (state, red) == ("proof held", [])
    assert re.fullmatch(
        r"3 certificates checked in this browser, .* statements of this page are what they prove\. Not judged here: .*",
        said,
    )
    for (_, edited), (state, said, red) in zip(EDITS[1:], others, strict=True):
        assert (state, red) == ("proof refuted", [edited])
        assert said.startswith("REFUSED: this page is not what its certificates prove, in 1 place,")
