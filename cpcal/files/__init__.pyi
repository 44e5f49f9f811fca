from .folders import (
    campaign_sha256,
    load_campaign,
    load_campaign_json,
    load_settings,
    load_study,
    save_campaign_json,
)
from .log import (
    Log,
    campaign_of_log,
    read_log,
)
from .settings import (
    Settings,
    save_campaign,
    save_study,
    settings_template,
)

__all__ = [
    "Log",
    "Settings",
    "campaign_of_log",
    "campaign_sha256",
    "load_campaign",
    "load_campaign_json",
    "load_settings",
    "load_study",
    "read_log",
    "save_campaign",
    "save_campaign_json",
    "save_study",
    "settings_template",
]
