from .folders import (
    Settings,
    campaign_sha256,
    load_campaign,
    load_campaign_json,
    load_settings,
    load_study,
    save_campaign,
    save_campaign_json,
    save_study,
    settings_template,
)
from .log import Log, campaign_of_log, read_log

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
