"""Campaigns as verbs read them: what looks mixed up is said on stderr before the work begins."""

from __future__ import annotations

from pathlib import Path

import typer

from cpcal.common.errors import printable
from cpcal.files import load_campaign
from cpcal.robot import Campaign
from cpcal.robot.mistakes import suspicions


def read_campaign(folder: Path) -> Campaign:
    """The campaign in a folder; see `warn`. Raises InputError."""
    return warn(load_campaign(folder))


def warn(campaign: Campaign) -> Campaign:
    """Say on stderr what looks wrong with the campaign."""
    for sentence in suspicions(campaign):
        typer.echo(printable(f"cpcal: warning: {sentence}"), err=True)
    return campaign
