"""The checker's verdicts, remembered: they follow from bytes alone, so what was accepted need not be judged again."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from hashlib import sha256
from pathlib import Path

from cpcal.checker import Accepted, ExactCampaign


def remembered(check: Callable[..., Accepted]) -> Callable[..., Accepted]:
    """`cpcal.checker.check` for many runs that share certificates; what it refuses it judges each time.

    The campaign is given, or the certificate states its constraints itself: no other file is looked for.
    """
    known: dict[object, Accepted] = {}

    @wraps(check)
    def judged(certificate: Path, campaign: ExactCampaign | None = None, **options: int) -> Accepted:
        of = None if campaign is None else campaign.sha256
        key = sha256(certificate.read_bytes()).hexdigest(), of, tuple(sorted(options.items()))
        if key not in known:
            found = check(certificate, campaign, **options)
            assert found.campaign == of
            known[key] = found
        return known[key]

    return judged
