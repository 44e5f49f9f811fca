"""Readers and writers of campaigns and studies: TOML and CSV."""

from cpcal.files.campaign_reader import (
    load_campaign,
)
from cpcal.files.campaign_writer import (
    save_campaign,
)
from cpcal.files.study_reader import (
    load_study,
)
from cpcal.files.study_writer import (
    save_study,
)

__all__ = [
    "load_campaign",
    "load_study",
    "save_campaign",
    "save_study",
]
