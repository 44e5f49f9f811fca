from .campaign_json import (
    campaign_sha256,
    load_campaign_json,
    save_campaign_json,
)
from .campaign_reader import (
    load_campaign,
)
from .campaign_writer import (
    save_campaign,
)
from .study_reader import (
    load_study,
)
from .study_writer import (
    save_study,
)

__all__ = [
    "campaign_sha256",
    "load_campaign",
    "load_campaign_json",
    "load_study",
    "save_campaign",
    "save_campaign_json",
    "save_study",
]
