"""Forgeries of steps, keys and the order of lines."""

from __future__ import annotations

from typing import Any

from tests.checker.forged.forging import (
    Lines,
    forgery,
)


@forgery()
def excluded_part_too_large(lines: Lines, proof: Any) -> str:
    lines[proof.index("split")]["at"] = lines[0]["hi"][-1]
    return "exclude"


@forgery()
def split_along_another_unknown(lines: Lines, proof: Any) -> str:
    lines[proof.index("split")].update(unknown=0, at=lines[0]["lo"][0])
    return "exclude"


@forgery()
def unknown_key_in_the_header(lines: Lines, proof: Any) -> str:
    lines[0]["note"] = "trust me"
    return "header"


@forgery()
def unknown_key_in_the_claims(lines: Lines, proof: Any) -> str:
    lines[proof.head]["feasible"] = True
    return "claims"


@forgery()
def unknown_key_in_the_point(lines: Lines, proof: Any) -> str:
    lines[proof.head]["point"]["reading"] = []
    return "claims"


@forgery()
def unknown_key_in_a_step(lines: Lines, proof: Any) -> str:
    lines[proof.index("pass")]["note"] = ""
    return "pass"


@forgery()
def unknown_key_in_weights(lines: Lines, proof: Any) -> str:
    lines[proof.index("exclude")]["weights"]["cubes"] = []
    return "exclude"


@forgery("network")
def unknown_key_in_a_constraint(lines: Lines, proof: Any) -> int:
    lines[1]["note"] = ""
    return 1


@forgery()
def claim_missing(lines: Lines, proof: Any) -> str:
    del lines[proof.head]["enclosure"]
    return "claims"


@forgery()
def claims_of_the_former_format(lines: Lines, proof: Any) -> str:
    old = lines[proof.head]
    new = {"cap": old["cap"], "eps_lo": old["epsilon"]["lo"], "enclosure": old["enclosure"], "eps_hi": old["cap"]}
    lines[proof.head] = new
    return "claims"


@forgery()
def pass_and_exclude_in_one(lines: Lines, proof: Any) -> str:
    lines[proof.index("pass")]["exclude"] = 2
    return "pass"


@forgery()
def no_step_at_all(lines: Lines, proof: Any) -> str:
    lines[proof.index("pass")] = {"because": "I say so"}
    return "pass"


@forgery()
def point_as_a_last_step(lines: Lines, proof: Any) -> str:
    lines.append({"point": lines[proof.head]["point"]["at"]})
    return "last"


@forgery()
def claims_twice(lines: Lines, proof: Any) -> str:
    lines.insert(proof.head, lines[proof.head])
    return "split"


@forgery()
def header_twice(lines: Lines, proof: Any) -> int:
    lines.insert(1, lines[0])
    return 1


@forgery()
def claims_first(lines: Lines, proof: Any) -> str:
    lines.insert(0, lines.pop(proof.head))
    return "header"


@forgery()
def split_dropped(lines: Lines, proof: Any) -> str:
    del lines[proof.index("split")]
    return "split"


@forgery()
def split_twice(lines: Lines, proof: Any) -> str:
    lines.insert(proof.index("split"), lines[proof.index("split")])
    return "exclude"


@forgery()
def leaf_dropped(lines: Lines, proof: Any) -> str:
    del lines[proof.index("exclude")]
    return "last"


@forgery()
def exclusion_twice(lines: Lines, proof: Any) -> str:
    lines.insert(proof.index("exclude"), lines[proof.index("exclude")])
    return "pass"


@forgery()
def pass_dropped(lines: Lines, proof: Any) -> str:
    del lines[proof.index("pass")]
    return "last"


@forgery()
def no_claims(lines: Lines, proof: Any) -> str:
    del lines[proof.head :]
    return "claims"


@forgery()
def no_steps(lines: Lines, proof: Any) -> str:
    del lines[proof.head + 1 :]
    return "last"
