"""The checker's verdicts, remembered: they follow from bytes alone, so what was accepted need not be judged again."""

from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import Accepted, check
from cpcal.checker.run import LegCertificates
from cpcal.cli import verify


def verify_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For `cpcal verify`, many times: a certificate that was accepted is not checked again, and no process begins."""
    known: dict[tuple[bytes, ...], Accepted] = {}

    def once(path: Path, *given: Any, **options: Any) -> Accepted:
        if not path.is_file():
            return check(path, *given, **options)
        of = path.with_name("campaign.json")
        key = path.read_bytes(), of.read_bytes() if of.exists() else b""
        if key not in known:
            known[key] = check(path, *given, **options)
        return known[key]

    def accepted(self: LegCertificates, name: Any) -> Accepted:
        if not isinstance(name, str) or name not in self.names or not (self.folder / name).is_file():
            return honest(self, name)
        of = self.folder / "campaign.json"
        key = (self.folder / name).read_bytes(), of.read_bytes() if of.exists() else b""
        if key not in known:
            known[key] = honest(self, name)
        return known[key]

    honest = LegCertificates.accepted
    monkeypatch.setattr(LegCertificates, "accepted", accepted)
    monkeypatch.setattr(verify, "check", once)
    monkeypatch.setattr(verify, "_PROCESSORS", 1)
