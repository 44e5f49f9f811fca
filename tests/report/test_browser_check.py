"""A page in real chromium: opened as it is it turns green, with an edited number red."""

import html
import json
import re

import pytest

import cpcal
from cpcal.files import save_campaign_json
from cpcal.report.run_page import render
from tests.report.test_browser import CHROMIUM, chromium

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no `chromium` on PATH (Debian: apt install chromium)")

# The browser's clock runs ahead of the page's worker, so each look first counts for a while; at most 600 looks.
_WATCH = """<!doctype html><meta charset="utf-8"><iframe src="page.html" id="frame"></iframe>
<pre id="out"></pre><script>
let count = 0;
const wait = setInterval(() => {
  for (let k = 0; k < 2e7; k++) count += k % 2;
  const page = document.getElementById("frame").contentDocument, status = page && page.getElementById("proof-status");
  if (!status || !/held|refuted/.test(status.className)) return;
  clearInterval(wait);
  const red = [...page.querySelectorAll("[data-claim].refuted")].map(e => e.textContent.trim());
  document.getElementById("out").textContent = JSON.stringify([status.className, status.textContent, red]);
}, 100);
</script>
"""


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    folder = tmp_path_factory.mktemp("checked")
    campaign = cpcal.simulate(seed=2, joint_error=10.0, factor=0.0, extremal=False, random_poses=12)
    result = cpcal.certify(campaign, legs=[1], delta=4.0, tolerance=0.01, certificates=folder)
    save_campaign_json(campaign, folder)
    return render(campaign, result, run=folder)


def opened(folder, page):
    """Class and text of the line on the proofs, and the texts of what turned red."""
    (folder / "page.html").write_text(page, encoding="utf-8")
    wrapper = folder / "wrapper.html"
    wrapper.write_text(_WATCH, encoding="utf-8")
    options = ("--allow-file-access-from-files", "--virtual-time-budget=60000", "--dump-dom")
    found = re.search(r'<pre id="out">(.+?)</pre>', chromium(folder, *options, wrapper.as_uri()).stdout)
    assert found is not None, "the page did not say how its check ended"
    return json.loads(html.unescape(found[1]))


def test_an_untouched_page_turns_green(text, tmp_path):
    state, said, red = opened(tmp_path, text)
    assert (state, red) == ("proof held", [])
    assert re.fullmatch(
        r"1 certificate checked in this browser, .* statements of this page are what they prove\. Not judged here: .*",
        said,
    )


@pytest.mark.parametrize(
    ("mark", "edited"),
    [
        (r'data-claim="overall" data-value="[^"]+">', "PASS"),
        (r'data-claim="count">', "13"),
        (r'data-claim="eps_lo" data-value="[^"]+">', "0.123"),
    ],
)
def test_an_edited_page_turns_red_where_it_was_edited(text, tmp_path, mark, edited):
    changed, times = re.subn(rf"({mark})[^<]+<", rf"\g<1>{edited}<", text)
    assert times == 1
    state, said, red = opened(tmp_path, changed)
    assert (state, red) == ("proof refuted", [edited])
    assert said.startswith("REFUSED: this page is not what its certificates prove, in 1 place,")
