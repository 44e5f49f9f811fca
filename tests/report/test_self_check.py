"""The page checks itself: its script, run by an embedded V8, finds every number that was edited."""

import base64
import hashlib
import json
import re
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.checker import Refused, check
from cpcal.cli import app
from cpcal.files import save_campaign_json
from cpcal.report import leg_sentence
from cpcal.report.run_page import render

mini_racer = pytest.importorskip("py_mini_racer", reason="mini-racer is not installed (pip install 'cpcal[test]')")

DRIVER = """
const bytesOf = text => Uint8Array.from(text, c => c.charCodeAt(0));
function told(campaign, certificates, shown) {
  const found = judged(bytesOf(campaign), certificates.map(c => ({...c, bytes: bytesOf(c.content)})), shown);
  return {faults: found.faults, refused: found.proofs.map(p => p.refused), marks: found.marks, own: found.own};
}
"""
SIDES = {of: [f"{of}.{side}" for side in ("lo", "hi", "width")] for of in ("ranges", "enclosure")}
FREE = ("box", "count")  # need no certificate: half-width as printed, measurements of the campaign in the page
ASKED = {"mid": {}, "pass": {"tolerance": 5.0}, "fail": {"tolerance": 0.01}, "yes": {"eps": 5.0}, "no": {"eps": 0.01}}


def source(name):
    return (files("cpcal.report") / "browser" / name).read_text(encoding="utf-8")


class Page(HTMLParser):
    """The scripts of a page by id, and what it claims as its own script reads it."""

    def __init__(self, text):
        super().__init__()
        self.scripts, self.policy, self.shown, self.open = {}, "", [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"]
        if tag not in ("meta", "br"):
            self.open.append((tag, found, []))

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_data(self, data):
        for _, _, texts in self.open:
            texts.append(data)

    def handle_endtag(self, tag):
        opened, found, texts = self.open.pop()
        assert opened == tag
        if tag == "script":
            self.scripts[found.get("id")] = "".join(texts)
        if "data-claim" in found:
            names = ("leg", "claim", "parameter", "value")
            number = {name: found[f"data-{name}"] for name in names if f"data-{name}" in found}
            self.shown.append({**number, "text": " ".join("".join(texts).split())})


@pytest.fixture(scope="module")
def engine():
    v8 = mini_racer.MiniRacer()
    for name in ("checker.js", "page.js"):
        v8.eval(source(name))
    v8.eval(DRIVER)
    return v8


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=2, joint_error=10.0, factor=0.0, extremal=False, random_poses=12)


@pytest.fixture(scope="module")
def runs(campaign, tmp_path_factory):
    """Folder and result of a run of one leg, for each way to ask."""

    def made(name):
        folder = tmp_path_factory.mktemp(name)
        asked = {"legs": [1], "delta": 4.0, "ranges": name == "mid"}
        found = cpcal.certify(campaign, certificates=folder, **asked, **ASKED[name])
        save_campaign_json(campaign, folder)
        return folder, found

    return {name: made(name) for name in ASKED}


@pytest.fixture(scope="module")
def pages(runs, campaign):
    return {name: Page(render(campaign, result, run=folder)) for name, (folder, result) in runs.items()}


def judged(engine, page, **changed):
    """What the page's script finds."""
    data = json.loads(page.scripts["proof-data"])

    def plain(deflated):
        return zlib.decompress(base64.b64decode(deflated)).decode("latin-1")

    certificates = [{**c, "content": plain(c["deflated"])} for c in data["certificates"]]
    given = {"campaign": plain(data["campaign"]), "certificates": certificates, "shown": page.shown} | changed
    return engine.call("told", given["campaign"], given["certificates"], given["shown"])


def texts(page, claim):
    return [number for number in page.shown if number["claim"] == claim]


@pytest.mark.parametrize("name", ASKED)
def test_an_untouched_page_agrees_with_its_certificates(engine, pages, name):
    page = pages[name]
    found = judged(engine, page)
    assert [(n, f) for n, f in zip(page.shown, found["faults"], strict=True) if f != ""] == []
    assert set(found["refused"]) == {""}
    assert len(page.shown) > (35 if name in ("mid", "pass") else 5)


OWN = cpcal.LegModel("own", "proved to be right", (cpcal.Parameter("k", "1", 0.05),), lambda m, x: m.length * x["k"])


@pytest.mark.parametrize("tolerance", [None, 5.0, 0.01])
def test_nothing_of_a_model_that_the_checker_does_not_know_is_green(engine, campaign, tmp_path, tolerance):
    found = cpcal.certify(campaign, legs=[1], delta=4.0, certificates=tmp_path, model=OWN, tolerance=tolerance)
    cpcal.save_result(found, tmp_path, campaign)
    if tolerance is None:
        done = CliRunner().invoke(app, ["verify", str(tmp_path)])
        assert (done.exit_code, "which were not compared with the campaign" in done.output) == (0, True), done.output
    text = cpcal.write_report(campaign, found, tmp_path, OWN).read_text(encoding="utf-8")
    assert text.count("which were not compared with the campaign") >= 3  # above all, of the model, and of the leg
    assert not re.search('class="verdict[^"]*(explained|bounded)"', text.replace("unexplained", ""))
    assert "proved to be right" not in text  # a formula that nobody compared
    assert "‖P + R b − a‖ =" not in text
    assert "not compared with the campaign" in leg_sentence(found, found.legs[0])
    page = Page(text)
    told, words = judged(engine, page), {number["text"] for number in texts(page, "verdict")}
    assert {None: "not compared", 5.0: "not compared", 0.01: "fail"}[tolerance] in words
    assert told["own"] == ["1"]
    assert not any(told["faults"])
    good = {number["claim"] for number, mark in zip(page.shown, told["marks"], strict=True) if mark == "good"}
    assert good <= {"campaign", "count", "box", "tolerance"}
    assert "own" in told["marks"]


def test_a_model_that_looks_like_one_of_ours_is_refused_wherever_its_name_comes_in(engine, campaign, tmp_path):
    """One letter of it is Cyrillic, or large; its one constraint is invented."""
    found = cpcal.certify(campaign, legs=[1], delta=4.0, certificates=tmp_path, model=OWN)
    cpcal.save_result(found, tmp_path)
    page, path = Page(render(campaign, found, model=OWN, run=tmp_path)), tmp_path / "leg1.cert.jsonl"
    files = {file: file.read_text(encoding="utf-8") for file in (path, tmp_path / "result.json")}
    for name, reason in (("pl\u0430in", "ASCII identifier"), ("Plain", "none of cpcal's"), ("gain", "one of cpcal's")):
        with pytest.raises(cpcal.InputError, match=r"is no ASCII identifier|is the name of a model of cpcal"):
            cpcal.certify(campaign, legs=[1], model=replace(OWN, name=name))
        for file, text in files.items():
            file.write_text(text.replace("model own", f"model {name}").replace('"own"', f'"{name}"'), encoding="utf-8")
        done = CliRunner().invoke(app, ["verify", str(tmp_path)])
        assert done.exit_code == 1
        assert "REFUSED" in done.output
        with pytest.raises(Refused, match=reason):
            check(path)
        certificate = {"leg": 1, "kind": "bracket", "name": path.name, "content": path.read_bytes().decode("latin-1")}
        assert "is of another leg or campaign" in judged(engine, page, certificates=[certificate])["refused"][0]


@pytest.mark.parametrize(
    ("name", "more"), [("mid", ["ranges.eps", *SIDES["ranges"]]), ("pass", ["tolerance", *SIDES["enclosure"]])]
)
def test_every_number_edited_is_found(engine, pages, name, more):
    page = pages[name]
    numbers = [k for k, number in enumerate(page.shown) if re.search(r"\d", number["text"])]
    claims = {page.shown[k]["claim"] for k in numbers}
    met = {"recommended", "recommended.largest", "passes.eps"}
    assert claims - {"verdict"} == {"eps_lo", "eps_hi", "point", "campaign", "box", "count", *met, *more}
    edited = []
    for number in (page.shown[k] for k in numbers):
        text = number["text"]
        digit = max(re.finditer(r"\d", text), key=lambda m: m.start())  # the last one
        other = text[: digit.start()] + str((int(digit[0]) + 4) % 10) + text[digit.end() :]
        edited.append({**number, "text": other})
    assert all(judged(engine, page, shown=edited)["faults"])


def test_a_number_edited_with_its_value_is_found(engine, pages):
    for name, claim, text, value in (
        ("mid", "eps_hi", "0.01", 0.01),
        ("mid", "ranges.eps", "0.25", 0.25),
        ("pass", "enclosure.lo", "1", 1.0),
    ):
        number = texts(pages[name], claim)[0]
        fault = judged(engine, pages[name], shown=[{**number, "text": text, "value": value.hex()}])["faults"]
        assert fault == ["the certificate claims another number"]


@pytest.mark.parametrize(("name", "other"), [("pass", "fail"), ("fail", "pass")])
def test_a_verdict_turned_round_is_found(engine, pages, name, other):
    page = pages[name]
    words = [number for number in texts(page, "verdict") if number["text"] == name]
    assert words
    assert judged(engine, page, shown=words)["faults"] == [""] * len(words)
    turned = [{**number, "text": other} for number in words]
    assert judged(engine, page, shown=turned)["faults"] == [f"a {other} is not proved"] * len(words)


@pytest.mark.parametrize(
    ("name", "claim", "text", "fault"),
    [
        ("pass", "overall", "FAIL", "a fail is not proved"),
        ("fail", "overall", "PASS", "a fail is proved"),
        ("fail", "overall", "UNDECIDED", "a fail is proved"),
        ("pass", "overall", "EXCELLENT", "it is no verdict"),
        ("pass", "count", "13", "the campaign in this page has 12 measurements"),
        ("pass", "tolerance", "4", "4 is not the number that is proved"),
    ],
)
def test_badge_and_headline_say_what_is_proved_of_all_legs(engine, pages, name, claim, text, fault):
    page = pages[name]
    (number,) = texts(page, claim)
    verdicts = texts(page, "verdict")
    assert judged(engine, page, shown=[number, *verdicts])["faults"][0] == ""
    assert judged(engine, page, shown=[{**number, "text": text}, *verdicts])["faults"][0] == fault


def test_words_that_no_certificate_speaks_of_are_not_judged_and_others_are(engine, pages):
    page = pages["fail"]
    word, *_ = texts(page, "verdict")
    told = {
        "undetermined: a_x, b_z": None,
        "undecided": "a fail is proved",
        "fits to within 1e-9 mm": "a fail is proved",
    }
    assert judged(engine, page, shown=[{**word, "text": text} for text in told])["faults"] == list(told.values())
    (word, *_), page = texts(pages["yes"], "verdict"), pages["yes"]
    told = {
        "fits to within 5 mm": "",
        "fits to within 4 mm": "4 is not rounded to the side that is proved",
        "fits within the stated reading uncertainty": "no exact fit is proved",
        "does not fit": "it is not refuted",
        "pass": "a pass is not proved",
    }
    assert judged(engine, page, shown=[{**word, "text": text} for text in told])["faults"] == list(told.values())
    assert "Not judged here: whether the measurements determine the parameters" in source("page.js")


def test_another_campaign_or_certificate_is_refused(engine, pages, runs):
    page = pages["mid"]
    content = (runs["mid"][0] / "campaign.json").read_text(encoding="utf-8")
    found = judged(engine, page, campaign=content.replace('"', ' "', 1))
    assert all(found["refused"])
    about = [fault for fault, number in zip(found["faults"], page.shown, strict=True) if number["claim"] not in FREE]
    assert all(about)
    assert set(judged(engine, page, certificates=[])["faults"]) <= {None, ""}  # no certificate: nothing is refused


def test_the_page_runs_its_own_script_only_and_is_the_same_each_time(runs, campaign):
    folder, result = runs["mid"]
    text = render(campaign, result, run=folder)
    assert text == render(campaign, result, run=folder)
    assert len(text) < 300_000
    page = Page(text)
    assert set(page.scripts) == {"proof-data", "proof-checker", None}
    scripts = [source("checker.js"), source("page.js")]
    assert [page.scripts["proof-checker"], page.scripts[None]] == scripts
    assert not any("</" in script or "<!--" in script for script in scripts)
    digest = base64.b64encode(hashlib.sha256(page.scripts[None].encode()).digest()).decode()
    rules = dict(rule.split(" ", 1) for rule in page.policy.split("; "))
    assert rules == {
        "default-src": "'none'", "style-src": "'unsafe-inline'", "script-src": f"'sha256-{digest}'",
        "worker-src": "blob:", "base-uri": "'none'", "form-action": "'none'",
    }  # fmt: skip
    assert "<noscript>" in text


def test_without_certificates_there_is_no_checker(runs, campaign, tmp_path):
    folder, result = runs["mid"]
    plain = render(campaign, result)
    assert "<script" not in plain
    assert render(campaign, result, run=tmp_path) == plain
    save_campaign_json(cpcal.simulate(seed=3), tmp_path)
    for path in folder.glob("*.cert.jsonl"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert render(campaign, result, run=tmp_path) == plain  # the campaign beside them is another
