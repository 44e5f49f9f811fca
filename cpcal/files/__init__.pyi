from .campaign_json import (
    campaign_sha256,
    load_campaign_json,
    save_campaign_json,
)
from .campaign_reader import (
    load_campaign,
    load_settings,
)
from .campaign_writer import (
    save_campaign,
)
from .log_import import (
    LogSettings,
    campaign_of_log,
)
from .log_reader import (
    Log,
    read_log,
)
from .settings_template import (
    settings_template,
)
from .study_reader import (
    load_study,
)
from .study_writer import (
    save_study,
)

__all__ = [
    "Log",
    "LogSettings",
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
