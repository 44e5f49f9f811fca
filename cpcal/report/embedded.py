"""What a page holds so that it can check itself: campaign, certificates, checker, script."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup

from cpcal.results import Result

_CAMPAIGN = "campaign.json"
_MOST = 4_000_000  # characters; a page with more is too slow to open


@dataclass(frozen=True)
class Embedded:
    """Made by us, or base64: nothing in it needs to be escaped.

    data     JSON: the campaign and the certificates, deflated
    checker  the certificate checker; it runs in a worker only
    script   the page's own script; source  its name in a content security policy
    """

    data: Markup
    checker: Markup
    script: Markup
    source: str


def embedded(run: Path | None, result: Result) -> Embedded | None:
    """Of the folder of a run; None where it holds no certificate of the result, or more than a page should.

    The same files give the same text.
    """
    certificates = [] if run is None else _certificates(run, result)
    if run is None or not certificates or not (run / _CAMPAIGN).is_file():
        return None
    campaign = (run / _CAMPAIGN).read_bytes()
    if hashlib.sha256(campaign).hexdigest() != result.campaign_sha256:
        return None
    data = json.dumps({"campaign": _deflated(campaign), "certificates": certificates}).replace("<", "\\u003c")
    if len(data) > _MOST:
        return None
    script = _script("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return Embedded(Markup(data), Markup(_script("checker.js")), Markup(script), f"'sha256-{digest}'")


def _certificates(run: Path, result: Result) -> list[dict[str, object]]:
    """Those of the brackets and of the ranges that lie in the folder."""
    out: list[dict[str, object]] = []
    for leg in result.legs:
        named = {"bracket": leg.certificate, "ranges": None if leg.ranges is None else leg.ranges.certificate}
        for kind, name in named.items():
            if name is not None and (run / name).is_file():
                content = _deflated((run / name).read_bytes())
                out.append({"leg": leg.leg, "kind": kind, "name": name, "deflated": content})
    return out


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _script(name: str) -> str:
    return (files("cpcal.report") / "browser" / name).read_text(encoding="utf-8")
