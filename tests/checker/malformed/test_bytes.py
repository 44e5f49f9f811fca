"""Bytes that are no certificate end in a clear refusal, at their line and in little memory."""

import json
import re
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import ExactCampaign, Refused, check
from cpcal.files.folders import CAMPAIGN_NAME
from tests.checker.valid.exact_legs import in_fractions

Lines = list[dict[str, Any]]


def encoded(lines: Lines) -> list[bytes]:
    return [json.dumps(line).encode() + b"\n" for line in lines]


def refused(checked: Any, content: bytes, folder: Path | None) -> Refused:
    with pytest.raises(Refused) as caught:
        checked(content, folder)
    assert str(caught.value).isascii()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300
    return caught.value


def test_every_truncation_is_refused(checked: Any, short_proof: Any) -> None:
    """Without its last step a certificate ends as well as with it, but does not prove what it claims."""
    content = b"".join(encoded(short_proof.lines))
    ends = [k for k in range(len(content)) if content[k : k + 1] == b"\n"]
    for size in sorted({*range(0, len(content) - 2, 151), *range(5), *ends[:-1], *(k + 1 for k in ends[:-1])}):
        caught = refused(checked, content[:size], short_proof.folder)
        whole = content[:size].count(b"\n")
        assert whole <= caught.line <= whole + 2


NO_CERTIFICATES = (
    *(b"", b"\n", b"{}\n", b"[]\n", b"null\n", b"\xff\xfe{\n", b"\xef\xbb\xbf{}\n", b"\x00" * 100),
    *(b'{"format": NaN}\n', b'{"format": Infinity}\n', b'{"leg": ' + b"9" * 5000 + b"}\n", b'{"format": "\\ud800"}\n'),
    *(b'{"format": "cpcal-certificate/6", "leg": 1e999}\n', b'{"\\ud800": "\\ud800"}\n', b'{"format": 1.5}\n'),
    *(b"[" * 100_000 + b"]" * 100_000, b'{"a":' * 100_000 + b"1" + b"}" * 100_000, b"{" + b" " * (5 << 20) + b"}\n"),
    *(b'{"format": "cpcal-certificate/6"} {}\n', b'{"format": 01}\n', b'{"a": 1,}\n', b'{"a": "\t"}\n'),
)


@pytest.mark.parametrize("content", NO_CERTIFICATES, ids=range(len(NO_CERTIFICATES)))
def test_files_that_are_none(checked: Any, exact_proof: Any, content: bytes) -> None:
    assert refused(checked, content, exact_proof.folder).line == 1
    assert refused(checked, content, None).line == 1


@pytest.mark.parametrize("key", [b'"cap"', b'"infeasible"', b'"epsilon"', b'"lo"', b'"at"', b'"holds"'])
def test_a_claim_twice(checked: Any, short_proof: Any, key: bytes) -> None:
    lines = encoded(short_proof.lines)
    at = short_proof.head
    assert key in lines[at]
    lines[at] = lines[at].replace(key, key + b": null, " + key, 1)
    caught = refused(checked, b"".join(lines), short_proof.folder)
    assert caught.line == at + 1
    assert "twice" in caught.reason


@pytest.mark.parametrize("depth", [100, 900, 940, 960, 980, 990, 1000])
def test_deep_values(depth: int, checked: Any, short_proof: Any) -> None:
    deep = b"[" * depth + b"]" * depth
    lines = encoded(short_proof.lines)
    head = short_proof.head
    claims = b'{"cap": 1, "infeasible": 1, "epsilon": 1, "enclosure": 1, "point": 1}\n'
    for key in (b"cap", b"infeasible", b"epsilon", b"enclosure", b"point"):
        line = claims.replace(b'"' + key + b'": 1', b'"' + key + b'": ' + deep)
        assert refused(checked, b"".join([*lines[:head], line]), short_proof.folder).line == head + 1
    step = b'{"pass": ' + deep + b', "cap": null, "rows": [], "bounds": []}\n'
    assert refused(checked, b"".join([*lines[:-1], step]), short_proof.folder).line == len(lines)
    if short_proof.folder is None:
        for key in (b"body", b"name", b"root"):
            line = lines[1].replace(b'"' + key + b'": ', b'"' + key + b'": ' + deep + b', "": ', 1)
            assert refused(checked, b"".join([lines[0], line]), None).line == 2


def peak_of(path: Path, folder: Path | None, match: str) -> int:
    tracemalloc.start()
    try:
        with pytest.raises(Refused, match=match):
            check(path, folder and folder / CAMPAIGN_NAME)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_long_file_takes_little_memory(tmp_path: Path, network_proof: Any) -> None:
    """Boxes are opened without end."""
    path = tmp_path / "long.jsonl"
    lines = encoded(network_proof.lines[:-1])
    cut = network_proof.lines[0]["lo"][1]
    with path.open("wb") as out:
        out.writelines(lines)
        for n in range(4000):
            out.writelines(encoded([{"split": 2 * n, "unknown": 1, "at": cut, "into": [2 * n + 1, 2 * n + 2]}]))
    assert peak_of(path, None, f"line {len(lines) + 4000}: box .* is still open below") < 32 << 20


def numbers(campaign: ExactCampaign) -> list[Any]:
    return [in_fractions(campaign.measurement(k, 3)) for k in range(len(campaign))]


@pytest.mark.parametrize("space", [1, 17 << 20])
def test_measurements_are_those_of_the_campaign_and_not_of_its_provenance(space, exact_proof, tmp_path):
    """In a file of more than 16 MiB the first line that said so once won."""
    content, path = (exact_proof.folder / CAMPAIGN_NAME).read_bytes(), tmp_path / CAMPAIGN_NAME
    _, rows = content.split(b'"measurements": [\n')
    others = b'"provenance": {\n"measurements": [\n' + rows.replace(b'"1', b'"2').strip() + b"," + b" " * space
    path.write_bytes(re.sub(rb'"provenance": .*', lambda _: others, content))
    assert path.stat().st_size > space + 2 * len(rows)
    assert numbers(ExactCampaign(path)) == numbers(ExactCampaign(exact_proof.folder / CAMPAIGN_NAME))
