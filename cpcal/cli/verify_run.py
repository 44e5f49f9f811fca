"""`cpcal verify` of a run: what its certificates prove, and what its result.json states besides."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cpcal.certify.recomputed import stated_otherwise
from cpcal.cli.checked import Legs, result_of
from cpcal.cli.claims import tell
from cpcal.cli.talk import Talk
from cpcal.common.errors import InputError, Problem, printable
from cpcal.files import load_campaign_json
from cpcal.files.run_folder import REPORT_NAME, unfinished
from cpcal.legs.models import BUILT_IN
from cpcal.report.words import missing_legs
from cpcal.results import INFORMATION, RESULT_NAME, Uncertified, information

_AGAIN = {  # what to do about a run in which no leg is certified
    Uncertified.INTERRUPTED: "again, without a limit that ends it too early",
    Uncertified.UNWRITTEN: "again, into a folder that has room",
    Uncertified.UNCHECKABLE: "fewer measurements at a time",
}


def run_verified(run: Path, checked: Callable[[], Legs], talk: Talk) -> bool:
    """Whether all of a run is accepted, and what is said of it; `checked` gives its legs. Raises InputError."""
    if unfinished(run):
        talk.say("Another run into this folder is at work, or was killed: these are the answers before it.")
    result = result_of(run)
    legs = result if isinstance(result, str) else checked()
    if isinstance(legs, str) or isinstance(result, str):
        talk.say(f"{RESULT_NAME}: REFUSED, {legs}")
        return False
    campaign = load_campaign_json(run)
    wrong = list(stated_otherwise(campaign, result))
    for sentence in wrong:
        talk.say(f"{RESULT_NAME}: REFUSED, {sentence}")
    if result.model.name not in {model.name for model in BUILT_IN}:
        talk.say(_unknown_model(result.model.name))
    missing = missing_legs(result, campaign.legs)
    if missing is not None:
        talk.say(missing)
    for leg, found in zip(legs, result.legs, strict=True):
        if leg.refused is not None:
            talk.say(f"leg {leg.leg}: REFUSED, {leg.refused}")
        elif leg.accepted is None:
            talk.say(f"leg {leg.leg}: NOT CERTIFIED, {found.not_certified}")
        ranges = None if found.ranges is None else found.ranges.certificate
        support = None if found.support_proof is None else found.support_proof.certificate
        for name, accepted in ((leg.certificate, leg.accepted), (support, leg.support), (ranges, leg.ranges)):
            if accepted is not None and name is not None:
                tell(talk, name, accepted)
        if found.ranges is not None and ranges is None:
            talk.say(f"leg {leg.leg}: its ranges are NOT CERTIFIED")
        for sentence in information(result.options, found):
            talk.say(f"leg {leg.leg}: {sentence}")
    talk.say(INFORMATION)
    if (run / REPORT_NAME).exists():
        talk.say(f"{REPORT_NAME} is not read here: `cpcal report` checks a run and writes its page again.")
    if not any(leg.accepted or leg.refused for leg in legs):
        remedy = next((_AGAIN[found.not_certified] for found in result.legs if found.not_certified in _AGAIN), "again")
        raise InputError([Problem(str(run), "holds no leg that is certified", f"certify {remedy}")])
    return not wrong and all(leg.refused is None for leg in legs)


def _unknown_model(name: str) -> str:
    return (
        f"The checker does not know the model {printable(name)}: its certificates state the constraints themselves. "
        "That these are the model's of this campaign is not checked."
    )
