"""`cpcal verify` compares all that compare.json states of legs with what the certificates claim."""

import json
import shutil

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Two legs under two models."""
    folder = tmp_path_factory.mktemp("compared")
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=14, joint_error=1.0, factor=0.0)
    cpcal.save_campaign(campaign, folder / "campaign")
    words = ["certify", str(folder / "campaign"), "-o", str(folder / "run"), "--model", "plain,lateral"]
    done = CliRunner().invoke(app, [*words, "--legs", "1,2", "--delta", "0.5", "--gap", "1e-2"])
    assert done.exit_code == 0, done.output
    return folder / "run"


def verified(run):
    return CliRunner().invoke(app, ["verify", str(run)])


def entries(change):
    return lambda data: change(data["entries"])


def swapped(entries):
    a, b = (entry["certificate"] for entry in entries[:2])
    entries[0]["certificate"], entries[1]["certificate"] = b, a


TAMPERED = {
    "a smaller eps_hi": entries(lambda e: e[0].update(eps_hi=0.9 * e[0]["eps_hi"])),
    "a larger eps_lo": entries(lambda e: e[0].update(eps_lo=1.1 * e[0]["eps_lo"])),
    "a smaller enclosure": entries(lambda e: e[0]["enclosure"]["lo"].__setitem__(0, e[0]["enclosure"]["hi"][0])),
    "a wider enclosure": entries(lambda e: e[0]["enclosure"]["lo"].__setitem__(0, -1e3)),
    "no enclosure": entries(lambda e: e[0]["enclosure"].update(lo=None, hi=None)),
    "another leg": entries(lambda e: e[0].update(subject="leg 3")),
    "another model": entries(lambda e: e[0].update(model="lateral")),
    "certificates that trade places": entries(swapped),
    "a leg's numbers under another leg and campaign": lambda data: (
        data.update(campaign_sha256="0" * 64) or data["entries"][0].update(subject="leg 5")
    ),
    "no campaign, and another leg": lambda data: (
        data.update(campaign_sha256=None, options=None) or data["entries"][0].update(subject="leg 5")
    ),
    "a larger box": lambda data: data["options"].update(delta=100.0),
    "another text of a model": lambda data: data["models"].update(plain="proved to be right"),
    "nothing said of what is determined": entries(lambda e: e[0]["information"].update(determination=None)),
    "a parameter called undetermined": entries(
        lambda e: e[0]["information"]["determination"].update(undetermined=["l"])
    ),
    "an entry left out": entries(list.pop),
    "an entry that is there twice": entries(lambda e: e.append(e[0])),
    "numbers without a certificate": entries(lambda e: e[0].update(certificate=None)),
}


def test_an_honest_comparison_is_accepted_and_holds_no_sentence(compared):
    assert verified(compared).exit_code == 0
    data = json.loads((compared / "compare.json").read_text(encoding="utf-8"))
    assert not any("status" in entry for entry in data["entries"])


@pytest.mark.parametrize("name", TAMPERED)
def test_a_comparison_that_was_touched_is_refused(compared, name, tmp_path):
    run = shutil.copytree(compared, tmp_path / "run")
    data = json.loads((run / "compare.json").read_text(encoding="utf-8"))
    TAMPERED[name](data)
    (run / "compare.json").write_text(json.dumps(data), encoding="utf-8")
    done = verified(run)
    assert done.exit_code == 1, done.output
    assert "REFUSED" in done.output
