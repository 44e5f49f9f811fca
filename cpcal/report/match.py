"""Whether a result, which may come from a file, is of this campaign and can be shown."""

from __future__ import annotations

from cpcal.common.errors import InputError, Problem, printable
from cpcal.files import campaign_sha256
from cpcal.results import Result
from cpcal.robot import Campaign


def check_match(campaign: Campaign, result: Result) -> None:
    """Raises InputError when the result is of another campaign, or of legs that it has not."""
    sha256 = campaign_sha256(campaign)
    if result.campaign_sha256 != sha256:
        what = f"is of another campaign (sha256 {printable(str(result.campaign_sha256))}, not {sha256})"
        raise InputError([Problem("result", what, "give the campaign that was certified, or certify this one")])
    absent = [leg.leg for leg in result.legs if leg.leg > campaign.legs]
    if absent:
        what, remedy = f"names a leg that is not there: {absent[0]}", f"certify again: legs are 1 to {campaign.legs}"
        raise InputError([Problem("result", what, remedy)])
