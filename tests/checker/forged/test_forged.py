"""Forgeries by hand: each is refused, at the line where the lie is told."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import pytest

from cpcal.checker import Refused

# the true certificates: header, (constraints,) claims, split, exclude, pass, halve (a split of what is left)
Lines = list[dict[str, Any]]
Forgery = Callable[[Lines, Any], str | int]  # changes the lines; the line that must be refused, by name or index
FORGERIES: dict[str, tuple[Forgery, tuple[str, ...]]] = {}
LEG, NETWORK, BOTH, GAIN = ("leg",), ("network",), ("leg", "network"), ("gain",)
PROOFS = {"leg": "split_proof", "network": "network_split_proof", "gain": "gain_proof"}


def forgery(*kinds: str) -> Callable[[Forgery], Forgery]:
    def known(change: Forgery) -> Forgery:
        FORGERIES[change.__name__] = change, kinds or BOTH
        return change

    return known


def place(
    name: str, line: str, *path: Any, value: Any, refused: str | None = None, kinds: tuple[str, ...] = BOTH
) -> None:
    """The forgery that puts `value` (or what it makes of the old one) at a path of a line."""

    def change(lines: Lines, proof: Any) -> str:
        target: Any = lines[1] if line == "constraint" else lines[proof.index(line)]
        first = target["bounds"][0][3]["rows"][0][0] if "first" in path else None
        *keys, end = (first if key == "first" else key for key in path)
        for key in keys:
            target = target[key]
        target[end] = value(target[end]) if callable(value) else value
        return line if refused is None else refused

    assert name not in FORGERIES, name
    FORGERIES[name] = change, kinds


def valued(text: str) -> float:
    return float.fromhex(text)


def moved(text: str, towards: float, ulps: int = 1) -> str:
    value = valued(text)
    for _ in range(ulps):
        value = math.nextafter(value, towards)
    return value.hex()


def negated(text: str) -> str:
    return (-valued(text)).hex()


UP, DOWN = math.inf, -math.inf
WEIGHTS = ("bounds", 0, 3)
ROW = ("rows", "first")  # the row of the step that the first bound has the first weight on

# the header
place("another format", "header", "format", value="cpcal-certificate/3")
place("format is a list", "header", "format", value=["cpcal-certificate/4"])
place("another digest", "header", "campaign", value=lambda t: t[:-1] + ("0" if t[-1] != "0" else "1"), kinds=LEG)
place("digest in capitals", "header", "campaign", value=str.upper, kinds=LEG)
place("digest is no text", "header", "campaign", value=0, kinds=LEG)
place("digest is null", "header", "campaign", value=None, kinds=LEG)
place("one measurement more", "header", "measurements", value=lambda n: n + 1, kinds=LEG)
place("one measurement less", "header", "measurements", value=lambda n: n - 1, kinds=LEG)
place("measurements as a float", "header", "measurements", value=float, kinds=LEG)
place("measurements as a list", "header", "measurements", value=lambda n: [n], kinds=LEG)
place("another leg", "header", "leg", value=2, refused="claims", kinds=LEG)
place("leg is 0", "header", "leg", value=0, kinds=LEG)
place("leg is true", "header", "leg", value=True, kinds=LEG)
place("leg is negative", "header", "leg", value=-1, kinds=LEG)
place("leg is a float", "header", "leg", value=1.0, kinds=LEG)
place("only not ascending", "header", "only", value=[1, 0], kinds=LEG)
place("only with one twice", "header", "only", value=[1, 1], kinds=LEG)
place("only an unknown number", "header", "only", value=[12], kinds=LEG)
place("only a negative number", "header", "only", value=[-1], kinds=LEG)
place("only true", "header", "only", value=[True], kinds=LEG)
place("only floats", "header", "only", value=[0.0, 1.0], kinds=LEG)
place("only all, as a text", "header", "only", value="all", kinds=LEG)
place("only is 0", "header", "only", value=0, kinds=LEG)
place("only none, weights on some", "header", "only", value=[], kinds=LEG)
place("empty box", "header", "lo", 2, value="0x1p+20", kinds=LEG)
place("seven unknowns", "header", "lo", value=lambda v: v[:7], kinds=LEG)
place("nine unknowns", "header", "hi", value=lambda v: [*v, v[-1]], kinds=LEG)
place("bound of the box is NaN", "header", "lo", 2, value="nan", kinds=LEG)
place("negative eps in the box", "header", "lo", 7, value="-0x1p-30", kinds=LEG)
place("least eps of the box is positive", "header", "lo", 7, value="0x1p-30", refused="claims", kinds=LEG)
place("wider box", "header", "hi", value=lambda v: [(valued(w) + 50).hex() for w in v], refused="exclude")
place("box up to huge numbers", "header", "hi", 0, value="0x1p+1100", refused="exclude")
place("box up to numbers beyond the format", "header", "hi", 0, value="0x1p+1101")
# the model
place("a model that there is not", "header", "model", value="stretched", kinds=GAIN)
place("the model in capitals", "header", "model", value="GAIN", kinds=GAIN)
place("the model's name with a space", "header", "model", value="gain ", kinds=GAIN)
place("no model", "header", "model", value=None, kinds=(*LEG, *GAIN))
place("model true", "header", "model", value=True, kinds=GAIN)
place("models in a list", "header", "model", value=["gain"], kinds=GAIN)
place("models in an object", "header", "model", value={"gain": 1}, kinds=GAIN)
place("plain for gain", "header", "model", value="plain", kinds=GAIN)
place("linear for gain", "header", "model", value="linear", kinds=GAIN)
place("lateral for gain", "header", "model", value="lateral", refused="claims", kinds=GAIN)
place("gain for plain", "header", "model", value="gain", kinds=LEG)
place("lateral for plain", "header", "model", value="lateral", kinds=LEG)
place("a wider range of gains above", "header", "hi", 7, value="0x1p-2", refused="pass", kinds=GAIN)
place("a wider range of gains below", "header", "lo", 7, value="-0x1p+0", refused="exclude", kinds=GAIN)
place("gains below -1", "header", "lo", 7, value="-0x1p+4", refused="exclude", kinds=GAIN)
place("no gain at all", "header", "lo", 7, value="0x1p-2", kinds=GAIN)
place("another gain of the point", "claims", "point", "at", 7, value="0x1p-2", kinds=GAIN)
place("bound with a gain one ulp beyond", "pass", "bounds", 0, 2, value=lambda t: moved(t, UP), kinds=GAIN)
place("eps_lo of the gain one ulp up", "claims", "epsilon", "lo", value=lambda t: moved(t, UP), refused="last",
      kinds=GAIN)  # fmt: skip
place("a weight of the gain's eps less", "pass", *WEIGHTS, "rows", 0, 1, value=lambda w: w - 1, kinds=GAIN)
place("upper is lower with a gain", "pass", *ROW, 0, value=lambda s: {"upper": "lower"}.get(s, "upper"),
      kinds=GAIN)  # fmt: skip
place("the gain in the place of eps", "pass", "bounds", 0, 0, value=7, kinds=GAIN)
place("an unknown beyond eps", "pass", "bounds", 0, 0, value=9, kinds=GAIN)
# numbers, the same everywhere: here the cap of the claims
place("number in decimal", "claims", "cap", value="1.5")
place("number as a float", "claims", "cap", value=1.5)
place("number as an integer", "claims", "cap", value=1)
place("number is true", "claims", "cap", value=True)
place("number is null", "claims", "cap", value=None)
place("number is NaN", "claims", "cap", value="nan")
place("number is infinite", "claims", "cap", value="inf")
place("huge exponent", "claims", "cap", value="0x1p9999")
place("five digits of exponent", "claims", "cap", value="0x1p-10000")
place("no exponent", "claims", "cap", value="0x1")
place("exponent without sign", "claims", "cap", value="0x1p0")
place("number in capitals", "claims", "cap", value="0X1P+0")
place("digits in capitals", "claims", "cap", value="0xAp-8")
place("number with spaces", "claims", "cap", value=" 0x1p-4")
place("number with underscores", "claims", "cap", value="0x1_0p-8")
place("number with a plus sign", "claims", "cap", value="+0x1p-4")
place("number with a newline", "claims", "cap", value="0x1p-4\n")
place("number with fullwidth digits", "claims", "cap", value="0x1p-\uff11")
place("65 digits before the point", "claims", "cap", value="0x" + "0" * 64 + "1p-4")
place("65 digits behind the point", "claims", "cap", value="0x0." + "0" * 64 + "1p+250")
place("no digit behind the point", "claims", "cap", value="0x1.p-4")
# the claims
place("cap above that of the problem", "claims", "cap", value=lambda text: moved(text, UP))
place("cap below that of the problem", "claims", "cap", value="-0x1p-30")
place("infeasible while a box is open", "claims", "infeasible", value=True, refused="last")
place("infeasible is 1", "claims", "infeasible", value=1)
place("infeasible is null", "claims", "infeasible", value=None)
place("eps_lo one ulp up", "claims", "epsilon", "lo", value=lambda text: moved(text, UP), refused="last")
place("eps_lo negative", "claims", "epsilon", "lo", value="-0x1p-1074")
place("eps_lo above the cap", "claims", "epsilon", "lo", value="0x1p+9")
place("eps_lo null", "claims", "epsilon", "lo", value=None)
place("eps_hi below eps_lo", "claims", "epsilon", "hi", value="0x1p-60")
place("eps_hi one ulp below that of the point", "claims", "epsilon", "hi", value=lambda text: moved(text, DOWN))
place("eps_hi one ulp above that of the point", "claims", "epsilon", "hi", value=lambda text: moved(text, UP))
place("eps_hi without a point", "claims", "point", value=None)
place("epsilon without hi", "claims", "epsilon", value=lambda e: {"lo": e["lo"]})
place("epsilon is a number", "claims", "epsilon", value=lambda e: e["lo"])
place("enclosure lo one ulp up", "claims", "enclosure", "lo", 0, value=lambda t: moved(t, UP), refused="last")
place("enclosure hi one ulp down", "claims", "enclosure", "hi", 2, value=lambda t: moved(t, DOWN), refused="last")
place("enclosure beside the box", "claims", "enclosure", "lo", 1, value="0x1p+99", refused="last")
place("enclosure of one less", "claims", "enclosure", "hi", value=lambda v: v[:-1])
place("enclosure without hi", "claims", "enclosure", value={"lo": []})
place("enclosure with NaN", "claims", "enclosure", "lo", 0, value="nan")
# the point
place("point elsewhere in the box", "claims", "point", "at", 0, value=lambda t: (valued(t) + 9e-4).hex())
place("point far away", "claims", "point", "at", 0, value="0x1p+20")
place("point with less eps", "claims", "point", "at", -1, value=lambda t: (0.9 * valued(t)).hex())
place("point with negative eps", "claims", "point", "at", -1, value=negated)
place("point of one less", "claims", "point", "at", value=lambda v: v[:-1])
place("point with NaN", "claims", "point", "at", 0, value="nan")
place("point holds some", "claims", "point", "holds", value="some")
place("point holds null", "claims", "point", "holds", value=None)
place("point holds true", "claims", "point", "holds", value=True)
place("eps_hi by a point judged by one", "claims", "point", "holds", value=[0])
place("eps_hi by a point judged by none", "claims", "point", "holds", value=[])
place("point holds at an unknown number", "claims", "point", "holds", value=[99])
place("point holds, not ascending", "claims", "point", "holds", value=[1, 0])
place("point fails where it holds", "claims", "point", "fails", value=[["upper", 3]])
place("point fails all", "claims", "point", "fails", value="all")
place("point fails at an unknown number", "claims", "point", "fails", value=[["upper", 99]])
place("point fails at true", "claims", "point", "fails", value=[["upper", True]])
place("point fails by a number", "claims", "point", "fails", value=[3])
place("point fails by no row", "claims", "point", "fails", value=[["upper"]])
place("point fails by no side", "claims", "point", "fails", value=[["middle", 3]])
place("readings are a text", "claims", "point", "readings", value="")
place("readings of one only", "claims", "point", "readings", value=[""])
place("readings are numbers", "claims", "point", "readings", value=lambda _: [0] * 99)
place("point without readings", "claims", "point", value=lambda p: {k: v for k, v in p.items() if k != "readings"})
# the split on the objective
place("cut below the box", "split", "at", value="-0x1p+0")
place("cut above the box", "split", "at", value="0x1p+9")
place("split of a box never made", "split", "split", value=7)
place("box name is false", "split", "split", value=False)
place("box name is a float", "split", "split", value=0.0)
place("box name is a text", "split", "split", value="0")
place("box name is a list", "split", "split", value=[0])
place("box name is negative", "split", "split", value=-1)
place("one child", "split", "into", value=[1])
place("three children", "split", "into", value=[1, 2, 3])
place("twins", "split", "into", value=[1, 1])
place("children swapped", "split", "into", value=[2, 1])
place("child named as its parent", "split", "into", value=[0, 1])
place("children named by floats", "split", "into", value=[1.0, 2.0])
place("children named by true", "split", "into", value=[True, 2])
place("children do not cover", "split", "at", value=lambda t: [t, moved(t, UP)])
place("split along an unknown too many", "split", "unknown", value=8)
place("split along unknown -1", "split", "unknown", value=-1)
place("split along true", "split", "unknown", value=True)
# the exclusion
place("wrong part excluded", "exclude", "exclude", value=2)
place("whole box excluded", "exclude", "exclude", value=0)
place("excluded cap below that of the claims", "exclude", "cap", value=lambda text: moved(text, DOWN))
place("excluded cap above that of the problem", "exclude", "cap", value=lambda text: moved(text, UP))
place("excluded without weights", "exclude", "weights", value={"rows": [], "products": [], "tangents": [],
                                                              "exponents": [0, 0, 0]})  # fmt: skip
place("weights without tangents", "exclude", "weights", value={"rows": [], "products": [], "exponents": [0, 0, 0]})
place("weights without exponents", "exclude", "weights", value={"rows": [], "products": [], "tangents": []})
place("weights null", "exclude", "weights", value=None)
place("excluded, rows very light", "exclude", "weights", "exponents", 0, value=-1000)
place("excluded, products very heavy", "exclude", "weights", "exponents", 1, value=999)
# the pass
for kind, bad in {
    "a float": 1.0,
    "a text": "1",
    "a number of the format": "0x1p+0",
    "negative": -1,
    "true": True,
    "null": None,
    "2^60": 1 << 60,
    "enormous": 10**4000,
    "a list": [1],
}.items():
    place(f"weight of a row {kind}", "pass", *WEIGHTS, "rows", 0, 1, value=bad)
    place(f"weight of a product {kind}", "pass", *WEIGHTS, "products", value=[[0, 1, 1, 1, bad]])
    place(f"weight of a tangent {kind}", "pass", *WEIGHTS, "tangents", value=[[0, "0x0p+0", bad]])
for kind, bad in {
    "1000": 1000,
    "-1001": -1001,
    "true": True,
    "a float": 0.0,
    "a text": "0",
    "null": None,
    "enormous": 10**4000,
}.items():
    place(f"exponent {kind}", "pass", *WEIGHTS, "exponents", 1, value=bad)
place("two exponents", "pass", *WEIGHTS, "exponents", value=lambda v: v[:2])
place("four exponents", "pass", *WEIGHTS, "exponents", value=lambda v: [*v, 0])
place("exponent of the rows one less", "pass", *WEIGHTS, "exponents", 0, value=lambda e: e - 1)
place("heaviest weight of a row", "pass", *WEIGHTS, "rows", 0, 1, value=(1 << 60) - 1)
place("weight of a row one less", "pass", *WEIGHTS, "rows", 0, 1, value=lambda w: w - 1)
place("row dropped", "pass", *WEIGHTS, "rows", value=lambda rows: rows[1:])
place("upper is lower", "pass", *ROW, 0, value=lambda s: {"upper": "lower"}.get(s, "upper"))
place("row of another measurement", "pass", *ROW, 1, value=lambda k: (k + 1) % 6)
place("row after the last", "pass", *ROW, 1, value=13)
place("row -1", "pass", *ROW, 1, value=-1)
place("row true", "pass", *ROW, 1, value=True)
place("row of no side", "pass", *ROW, 0, value="middle")
place("side of constraints in a leg", "pass", *ROW, 0, value="sign", kinds=LEG)
place("side of a leg in constraints", "pass", *ROW, 0, value="length", kinds=NETWORK)
place("side is a list", "pass", *ROW, 0, value=["upper"])
place("row of four", "pass", *ROW, value=lambda row: [*row[:2], "", ""])
place("rows are an object", "pass", "rows", value={})
place("weights of rows are an object", "pass", *WEIGHTS, "rows", value={})
place("weight of a row after the last", "pass", *WEIGHTS, "rows", 0, 0, value=10_000)
place("weight of row -1", "pass", *WEIGHTS, "rows", 0, 0, value=-1)
place("weight of row true", "pass", *WEIGHTS, "rows", 0, 0, value=True)
place("weights of other rows", "pass", *WEIGHTS, "rows",
      value=lambda rows: [[n, w] for (n, _), (_, w) in zip(rows, [*rows[1:], rows[0]], strict=True)])  # fmt: skip
place("weight of a row of three", "pass", *WEIGHTS, "rows", 0, value=lambda entry: [*entry, 1])
place("rows left out, weights kept", "pass", "rows", value=[])
place("product with p = 2", "pass", *WEIGHTS, "products", value=[[0, 1, 2, 1, 9]])
place("product with q = 0", "pass", *WEIGHTS, "products", value=[[0, 1, 1, 0, 9]])
place("product with p = 1.0", "pass", *WEIGHTS, "products", value=[[0, 1, 1.0, 1, 9]])
place("product with p = true", "pass", *WEIGHTS, "products", value=[[0, 1, True, 1, 9]])
place("product of an unknown too many", "pass", *WEIGHTS, "products", value=[[0, 8, 1, 1, 9]])
place("product of unknown -1", "pass", *WEIGHTS, "products", value=[[-1, 0, 1, 1, 9]])
place("product of four", "pass", *WEIGHTS, "products", value=[[0, 1, 1, 9]])
place("tangent of an unknown too many", "pass", *WEIGHTS, "tangents", value=[[8, "0x0p+0", 9]])
place("tangent at infinity", "pass", *WEIGHTS, "tangents", value=[[0, "inf", 9]])
place("tangent at a float", "pass", *WEIGHTS, "tangents", value=[[0, 0.0, 9]])
place("bound of an unknown too many", "pass", "bounds", 0, 0, value=8)
place("bound of unknown true", "pass", "bounds", 0, 0, value=True)
place("bound on no side", "pass", "bounds", 0, 1, value="both")
place("bound on the other side", "pass", "bounds", 0, 1, value=lambda s: {"lo": "hi"}.get(s, "lo"))
place("bound one ulp beyond", "pass", "bounds", 0, 2, value=lambda t: moved(t, UP))
place("bound at a huge number", "pass", "bounds", 0, 2, value="0x1p+9999")
place("bound of three", "pass", "bounds", 0, value=lambda entry: entry[:3])
place("pass on a closed box", "pass", "pass", value=1)
place("pass on a split box", "pass", "pass", value=0)
place("pass with a cap below that of the claims", "pass", "cap", value=lambda text: moved(text, DOWN))
place("pass without a cap", "pass", "cap", value=None)
place("pass without bounds", "pass", "bounds", value=[], refused="last")
place("bounds are an object", "pass", "bounds", value={})
# the second split
place("names used before", "halve", "into", value=[1, 2])
place("names left out", "halve", "into", value=[4, 5])
place("cut outside the box", "halve", "at", value="0x1p+20")
# readings
place("six signs", "pass", *ROW, 2, value=lambda t: t[:6], kinds=GAIN)
place("eight signs", "pass", *ROW, 2, value=lambda t: t + "0", kinds=GAIN)
place("signs that are none", "pass", *ROW, 2, value=lambda t: t[:6] + "1", kinds=GAIN)
place("signs in a list", "pass", *ROW, 2, value=list, kinds=GAIN)
place("signs are null", "pass", *ROW, 2, value=7, kinds=GAIN)
place("opposite signs", "pass", *ROW, 2, value=lambda t: t.translate(str.maketrans("+-", "-+")), kinds=GAIN)
place("signs left out", "pass", *ROW, value=lambda row: row[:2], kinds=GAIN)
place("signs of exact constraints", "pass", *ROW, value=lambda row: [*row, "+++++++"], kinds=NETWORK)
place("opposite readings of the point", "claims", "point", "readings",
      value=lambda r: [t.translate(str.maketrans("+-", "-+")) for t in r], kinds=GAIN)  # fmt: skip
place("centres for readings of the point", "claims", "point", "readings", value=None, kinds=GAIN)
place("a reading of the point too few", "claims", "point", "readings", value=lambda r: r[1:], kinds=GAIN)
place("a reading of the point with a sign too few", "claims", "point", "readings", 0, value="+++", kinds=GAIN)
place("signs of readings of constraints", "claims", "point", "readings", value=lambda _: ["+"] * 14, kinds=NETWORK)
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
def the_point_judged_by_all_but_one(lines: Lines, proof: Any) -> str:
    lines[proof.head]["point"]["holds"] = list(range(1, proof.problem.count))
    return "claims"


@forgery()
def the_point_outside_the_box(lines: Lines, proof: Any) -> str:
    lines[0]["hi"][0] = moved(lines[proof.head]["point"]["at"][0], DOWN)
    return "claims"


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


CASES = [(name, kind) for name, (_, kinds) in FORGERIES.items() for kind in kinds]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_forgeries_are_refused_at_their_line(
    name: str, kind: str, request: pytest.FixtureRequest, verdict: Any
) -> None:
    proof = request.getfixturevalue(PROOFS[kind])
    lines = proof.copy()
    where = FORGERIES[name][0](lines, proof)
    assert json.dumps(lines) != json.dumps(proof.lines)
    expected = 1 + (where if isinstance(where, int) else len(lines) - 1 if where == "last" else proof.index(where))
    if where == "constraint":
        expected = 2
    with pytest.raises(Refused) as caught:
        verdict(lines, proof.folder)
    assert caught.value.line == expected, str(caught.value)
    assert str(caught.value).startswith(f"line {expected}: ")
    assert str(caught.value).isascii()
    assert str(caught.value).isprintable()


def test_there_are_enough() -> None:
    assert sum(kind == "leg" for _, kind in CASES) >= 100
    assert sum(kind == "network" for _, kind in CASES) >= 100
