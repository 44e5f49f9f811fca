"""Forgeries of constraints, claims and points."""

from __future__ import annotations

from typing import Any

from tests.checker.forged.forging import (
    DOWN,
    NETWORK,
    UP,
    Lines,
    forgery,
    moved,
    place,
)


@forgery("network")
def one_constraint_less_than_there_are(lines: Lines, proof: Any) -> int:
    lines[0]["constraints"] -= 1
    return int(proof.head) - 1


@forgery("network")
def a_constraint_dropped(lines: Lines, proof: Any) -> int:
    del lines[1]
    return int(proof.head) - 1  # the claims, where a constraint is due


@forgery("network")
def no_objective_but_epsilon(lines: Lines, proof: Any) -> str:
    lines[0]["objective"] = lines[proof.head]["cap"] = None
    return "claims"


@forgery("network")
def no_objective_but_caps_of_steps(lines: Lines, proof: Any) -> str:
    lines[0]["objective"] = lines[proof.head]["cap"] = lines[proof.head]["epsilon"] = None
    return "exclude"


@forgery("network")
def roots_and_squares_swapped(lines: Lines, proof: Any) -> str:
    for line in lines[1 : proof.head]:
        line["root"] = not line["root"]
    return "claims"


def used(lines: Lines, proof: Any, side: str) -> dict[str, Any]:
    """A constraint that counts for the bound on the objective, with that side."""
    step = lines[proof.index("pass")]
    rows = [step["rows"][n] for n, _ in step["bounds"][0][3]["rows"]]
    return next(lines[1 + k] for s, k in rows if s == side and lines[1 + k]["root"])


@forgery("network")
def a_coefficient_one_ulp_looser_above(lines: Lines, proof: Any) -> str:
    term = used(lines, proof, "upper")["body"][0]
    assert term[0] == []
    term[1] = moved(term[1], DOWN)
    return "pass"


@forgery("network")
def a_coefficient_one_ulp_looser_below(lines: Lines, proof: Any) -> str:
    term = used(lines, proof, "lower")["body"][0]
    term[1] = moved(term[1], UP)
    return "pass"


@forgery("network")
def a_bound_one_ulp_looser(lines: Lines, proof: Any) -> str:
    term = used(lines, proof, "upper")["at_most"][0]
    assert term[0] == []
    term[1] = moved(term[1], UP)
    return "pass"


@forgery("network")
def an_upper_bound_dropped(lines: Lines, proof: Any) -> str:
    used(lines, proof, "upper")["at_most"] = None
    return "pass"


@forgery("network")
def a_lower_bound_dropped(lines: Lines, proof: Any) -> str:
    used(lines, proof, "lower")["at_least"] = None
    return "pass"


@forgery("network")
def a_square_for_a_root(lines: Lines, proof: Any) -> str:
    """Of one constraint only, and without the point, which sees it first."""
    lines[proof.head]["point"] = lines[proof.head]["epsilon"]["hi"] = None
    used(lines, proof, "lower")["root"] = False
    return "exclude"


@forgery("network")
def a_campaign_beside_the_constraints(lines: Lines, proof: Any) -> str:
    lines[0]["campaign"] = ""
    return "header"


@forgery("leg")
def about_beside_the_campaign(lines: Lines, proof: Any) -> str:
    lines[0]["about"] = ""
    return "header"


@forgery("leg")
def a_weight_on_a_measurement_left_out(lines: Lines, proof: Any) -> str:
    step = lines[proof.index("exclude")]
    k = step["rows"][step["weights"]["rows"][0][0]][1]
    lines[0]["only"] = [n for n in range(lines[0]["measurements"]) if n != k]
    return "exclude"


@forgery("leg")
def a_measurement_left_out_judges_the_point(lines: Lines, proof: Any) -> str:
    lines[0]["only"] = list(range(lines[0]["measurements"] - 1))
    lines[proof.head]["point"]["holds"] = list(range(lines[0]["measurements"]))
    return "claims"


@forgery("leg")
def a_measurement_left_out_refutes_the_point(lines: Lines, proof: Any) -> str:
    lines[0]["only"] = list(range(lines[0]["measurements"] - 1))
    lines[proof.head]["point"].update(at=["0x1p+20"] * 8, holds=[], fails=[["upper", lines[0]["measurements"] - 1]])
    return "claims"


@forgery("leg")
def rows_of_another_leg_without_a_point(lines: Lines, proof: Any) -> str:
    lines[0]["leg"] = 2
    lines[proof.head]["point"] = lines[proof.head]["epsilon"]["hi"] = None
    return "exclude"


@forgery("gain")
def the_header_of_version_3(lines: Lines, proof: Any) -> str:
    lines[0]["format"] = "cpcal-certificate/3"
    del lines[0]["model"]
    return "header"


@forgery("leg", "gain")
def the_model_left_out(lines: Lines, proof: Any) -> str:
    del lines[0]["model"]
    return "header"


@forgery("gain")
def a_proof_of_the_plain_model_for_the_gain_model(lines: Lines, proof: Any) -> str:
    """No gain in the claims, any gain in the problem."""
    for side in ("lo", "hi"):
        lines[proof.head]["enclosure"][side][7] = "0x0p+0"
    return "last"


@forgery()
def the_point_holds_where_it_fails(lines: Lines, proof: Any) -> str:
    claims = lines[proof.head]
    x = [*proof.point[:-1], 0.0]
    bad = next(k for k in range(proof.problem.count) if proof.fails(k, x))
    claims["epsilon"]["hi"] = None
    claims["point"] = {"at": [v.hex() for v in x], "holds": [bad], "readings": None, "fails": []}
    return "claims"


@forgery()
def the_point_fails_where_it_holds(lines: Lines, proof: Any) -> str:
    claims = lines[proof.head]
    x = [*proof.point[:-1], 0.5 * proof.eps_hi]
    rows = [proof.fails(k, x) for k in range(proof.problem.count)]
    bad = next(row for row in rows if row is not None)
    claims["epsilon"]["hi"] = None
    claims["point"] = {"at": [v.hex() for v in x], "holds": [], "readings": None}
    claims["point"]["fails"] = [[bad[0], rows.index(None), *bad[2:]]]
    return "claims"


@forgery()
def the_point_fails_twice_at_one_measurement(lines: Lines, proof: Any) -> str:
    """Counts of what a point fails are made of these rows."""
    claims = lines[proof.head]
    x = [*proof.point[:-1], 0.5 * proof.eps_hi]
    bad = next([row[0], k, *row[2:]] for k in range(proof.problem.count) if (row := proof.fails(k, x)) is not None)
    claims["epsilon"]["hi"] = None
    claims["point"] = {"at": [v.hex() for v in x], "holds": [], "readings": None, "fails": [bad, bad]}
    return "claims"


@forgery()
def the_point_judged_by_all_but_one(lines: Lines, proof: Any) -> str:
    lines[proof.head]["point"]["holds"] = list(range(1, proof.problem.count))
    return "claims"


@forgery()
def the_point_outside_the_box(lines: Lines, proof: Any) -> str:
    lines[0]["hi"][0] = moved(lines[proof.head]["point"]["at"][0], DOWN)
    return "claims"


# constraints
place("objective too many", "header", "objective", value=4, kinds=NETWORK)
place("objective by its name", "header", "objective", value="t", kinds=NETWORK)
place("objective -1", "header", "objective", value=-1, kinds=NETWORK)
place("objective true", "header", "objective", value=True, kinds=NETWORK)
place("another objective", "header", "objective", value=0, refused="claims", kinds=NETWORK)
place("no objective, but a cap", "header", "objective", value=None, refused="claims", kinds=NETWORK)
place("an unknown twice", "header", "unknowns", value=lambda v: [v[0], *v[:-1]], kinds=NETWORK)
place("an unknown without a name", "header", "unknowns", value=lambda v: [None, *v[1:]], kinds=NETWORK)
place("no unknowns", "header", "unknowns", value=[], kinds=NETWORK)
place("unknowns are a text", "header", "unknowns", value="abct", kinds=NETWORK)
place("about a number", "header", "about", value=1, kinds=NETWORK)
place("one constraint more than there are", "header", "constraints", value=lambda n: n + 1, refused="claims",
      kinds=NETWORK)  # fmt: skip
place("too many constraints", "header", "constraints", value=100_001, kinds=NETWORK)
place("constraints true", "header", "constraints", value=True, kinds=NETWORK)
place("a monomial unsorted", "constraint", "body", 0, 0, value=[1, 0], kinds=NETWORK)
place("a monomial of degree 9", "constraint", "body", 0, 0, value=[0] * 9, kinds=NETWORK)
place("a monomial of an unknown too many", "constraint", "body", 0, 0, value=[4], kinds=NETWORK)
place("a monomial of true", "constraint", "body", 0, 0, value=[True], kinds=NETWORK)
place("a monomial of a text", "constraint", "body", 0, 0, value="a", kinds=NETWORK)
place("a monomial twice", "constraint", "body", value=lambda p: [*p, p[0]], kinds=NETWORK)
place("a coefficient as a float", "constraint", "body", 0, 1, value=1.0, kinds=NETWORK)
place("a body null", "constraint", "body", value=None, kinds=NETWORK)
place("a body as an object", "constraint", "body", value={}, kinds=NETWORK)
place("a bound as a number", "constraint", "at_most", value="0x1p+0", kinds=NETWORK)
place("root is 1", "constraint", "root", value=1, kinds=NETWORK)
place("root is null", "constraint", "root", value=None, kinds=NETWORK)
place("a constraint without a name", "constraint", "name", value=None, kinds=NETWORK)
place("a bound impossible", "constraint", "at_most", value=[[[], "-0x1p+0"]], refused="claims", kinds=NETWORK)
