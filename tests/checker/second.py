"""The checker of pages, in JavaScript, beside the one in Python: what the tests of both share."""

import hashlib
import json
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

from cpcal.checker import Accepted, Refused

DRIVER = """
const bytesOf = text => Uint8Array.from(text, c => c.charCodeAt(0));
function told(certificate, campaign, sha256) {
  try {
    const known = campaign === null ? null : readCampaign(bytesOf(campaign), sha256);
    const {claims, steps} = checkCertificate(bytesOf(certificate), known);
    return {steps, infeasible: claims.infeasible, eps: claims.epsilon !== null, point: claims.point !== null};
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    return {line: error.line, code: error.code, message: error.message};
  }
}
"""
Second = Callable[[bytes, Path | None], dict[str, Any]]


def second_checker() -> Second | None:
    """What the checker in JavaScript tells of the bytes of a certificate and of the folder of its campaign.

    None where mini-racer, which runs it, is not installed.
    """
    try:
        import py_mini_racer as mini_racer
    except ImportError:
        return None
    engine = mini_racer.MiniRacer()
    engine.eval((files("cpcal.report") / "browser" / "checker.js").read_text())
    engine.eval(DRIVER)

    def told(content: bytes, folder: Path | None) -> dict[str, Any]:
        campaign = None if folder is None else (folder / "campaign.json").read_bytes()
        sha256 = None if campaign is None else hashlib.sha256(campaign).hexdigest()
        text = None if campaign is None else campaign.decode("latin-1")
        found: dict[str, Any] = engine.call("told", content.decode("latin-1"), text, sha256)
        return found

    return told


def encoded(lines: list[dict[str, Any]]) -> bytes:
    return b"".join(json.dumps(line).encode() + b"\n" for line in lines)


def told(verdict: Accepted | Refused, content: bytes) -> dict[str, Any]:
    """The verdict of the checker in Python on these bytes, as the other one tells it."""
    if isinstance(verdict, Refused):
        return {"line": verdict.line or 0, "code": verdict.code}
    claims = verdict.claims
    found = {"infeasible": claims.infeasible, "eps": claims.eps_lo is not None, "point": claims.point is not None}
    return {**found, "steps": len(content.splitlines())}


def agreed(first: dict[str, Any], second: dict[str, Any]) -> str:
    """The code of the refusal, or "" where both accept. Where one meets its limits, the other may refuse elsewhere."""
    other = {name: value for name, value in second.items() if name != "message"}
    if "limit" in (first.get("code"), other.get("code")) and "line" in first and "line" in other:
        return "limit"
    assert other == first
    return str(first.get("code", ""))
