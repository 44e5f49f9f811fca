"""Forgeries of true certificates by hand, each with its name and the line that must be refused."""

import math
from collections.abc import Callable
from typing import Any

from cpcal.solver.certificate.prover import claims as claimed
from cpcal.solver.certificate.recording import with_readings
from tests.checker.proofs import all_readings

# the true certificates: header, (constraints,) claims, split, exclude, pass, halve (a split of what is left)
Lines = list[dict[str, Any]]
Change = Callable[[Lines, Any], object]
Changes = dict[str, tuple[str | int, Change]]
FORGERIES: dict[str, tuple[str | int, Change, tuple[str, ...]]] = {}
LEG, NETWORK, BOTH, GAIN = ("leg",), ("network",), ("leg", "network"), ("gain",)
PROOFS = {"leg": "split_proof", "network": "network_split_proof", "gain": "gain_proof"}
HEAD = 1 << 20  # the line of the claims


def place(name, line, *path, value, refused=None, kinds=BOTH):
    """The forgery that puts `value` (or what it makes of the old one) at a path of a line."""

    def change(lines: Lines, proof: Any) -> None:
        target: Any = lines[1] if line == "constraint" else lines[proof.index(line)]
        first = target["bounds"][0][3]["rows"][0][0] if "first" in path else None
        *keys, end = (first if key == "first" else key for key in path)
        for key in keys:
            target = target[key]
        target[end] = value(target[end]) if callable(value) else value

    assert name not in FORGERIES, name
    FORGERIES[name] = refused or line, change, kinds


def valued(text: str) -> float:
    return float.fromhex(text)


def moved(text: str, towards: float, ulps: int = 1) -> str:
    value = valued(text)
    for _ in range(ulps):
        value = math.nextafter(value, towards)
    return value.hex()


UP, DOWN = math.inf, -math.inf
WEIGHTS = ("bounds", 0, 3)
ROW = ("rows", "first")  # the row of the step that the first bound has the first weight on

# the header
place("another format", "header", "format", value="cpcal-certificate/3")
place("another digest", "header", "campaign", value=lambda t: t[:-1] + ("0" if t[-1] != "0" else "1"), kinds=LEG)
place("digest in capitals", "header", "campaign", value=str.upper, kinds=LEG)
place("one measurement more", "header", "measurements", value=lambda n: n + 1, kinds=LEG)
place("one measurement less", "header", "measurements", value=lambda n: n - 1, kinds=LEG)
place("another leg", "header", "leg", value=2, refused="claims", kinds=LEG)
place("leg is 0", "header", "leg", value=0, kinds=LEG)
place("only not ascending", "header", "only", value=[1, 0], kinds=LEG)
place("only with one twice", "header", "only", value=[1, 1], kinds=LEG)
place("only an unknown number", "header", "only", value=[12], kinds=LEG)
place("only none, weights on some", "header", "only", value=[], kinds=LEG)
place("empty box", "header", "lo", 2, value="0x1p+20", kinds=LEG)
place("negative eps in the box", "header", "lo", 7, value="-0x1p-30", kinds=LEG)
place("least eps of the box is positive", "header", "lo", 7, value="0x1p-30", refused="claims", kinds=LEG)
place("wider box", "header", "hi", value=lambda v: [(valued(w) + 50).hex() for w in v], refused="exclude")
place("box up to huge numbers", "header", "hi", 0, value="0x1p+1100", refused="exclude")
place("box up to numbers beyond the format", "header", "hi", 0, value="0x1p+1101")
# the model
place("a model that there is not", "header", "model", value="stretched", kinds=GAIN)
place("the model in capitals", "header", "model", value="GAIN", kinds=GAIN)
place("plain for gain", "header", "model", value="plain", kinds=GAIN)
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
place("a weight of the gain's eps less", "pass", *WEIGHTS, "rows", 0, 1, value=lambda w: w - w // 4, kinds=GAIN)
place("upper is lower with a gain", "pass", *ROW, 0, value=lambda s: {"upper": "lower"}.get(s, "upper"),
      kinds=GAIN)  # fmt: skip
place("the gain in the place of eps", "pass", "bounds", 0, 0, value=7, kinds=GAIN)
place("an unknown beyond eps", "pass", "bounds", 0, 0, value=9, kinds=GAIN)
# numbers, the same everywhere: here the cap of the claims
NO_NUMBERS = ("1.5", "nan", "inf", "0x1p9999", "0x1p-10000", "0x1", "0x1p0", "0X1P+0", "0xAp-8", " 0x1p-4", "0x1_0p-8",
              "+0x1p-4", "0x1p-4\n", "0x1p-\uff11", "0x" + "0" * 64 + "1p-4", "0x0." + "0" * 64 + "1p+250",
              "0x1.p-4")  # fmt: skip
for text in NO_NUMBERS:
    place(f"the number {text!r}", "claims", "cap", value=text)
# the claims
place("cap above that of the problem", "claims", "cap", value=lambda text: moved(text, UP))
place("cap below that of the problem", "claims", "cap", value="-0x1p-30")
place("infeasible while a box is open", "claims", "infeasible", value=True, refused="last")
place("eps_lo one ulp up", "claims", "epsilon", "lo", value=lambda text: moved(text, UP), refused="last")
place("eps_lo negative", "claims", "epsilon", "lo", value="-0x1p-1074")
place("eps_lo above the cap", "claims", "epsilon", "lo", value="0x1p+9")
place("eps_hi below eps_lo", "claims", "epsilon", "hi", value="0x1p-60")
place("eps_hi one ulp below that of the point", "claims", "epsilon", "hi", value=lambda text: moved(text, DOWN))
place("eps_hi one ulp above that of the point", "claims", "epsilon", "hi", value=lambda text: moved(text, UP))
place("eps_hi without a point", "claims", "point", value=None)
place("enclosure lo one ulp up", "claims", "enclosure", "lo", 0, value=lambda t: moved(t, UP), refused="last")
place("enclosure hi one ulp down", "claims", "enclosure", "hi", 2, value=lambda t: moved(t, DOWN), refused="last")
place("enclosure beside the box", "claims", "enclosure", "lo", 1, value="0x1p+99", refused="last")
# the point
place("point elsewhere in the box", "claims", "point", "at", 0, value=lambda t: (valued(t) + 9e-4).hex())
place("point far away", "claims", "point", "at", 0, value="0x1p+20")
place("point with less eps", "claims", "point", "at", -1, value=lambda t: (0.9 * valued(t)).hex())
place("point with negative eps", "claims", "point", "at", -1, value=lambda t: (-valued(t)).hex())
place("point holds some", "claims", "point", "holds", value="some")
place("eps_hi by a point judged by one", "claims", "point", "holds", value=[0])
place("eps_hi by a point judged by none", "claims", "point", "holds", value=[])
place("point holds at an unknown number", "claims", "point", "holds", value=[99])
place("point holds, not ascending", "claims", "point", "holds", value=[1, 0])
place("point fails where it holds", "claims", "point", "fails", value=[["upper", 3]])
place("point fails at an unknown number", "claims", "point", "fails", value=[["upper", 99]])
place("readings of one only", "claims", "point", "readings", value=[""])
# the split on the objective
place("cut below the box", "split", "at", value="-0x1p+0")
place("cut above the box", "split", "at", value="0x1p+9")
place("split of a box never made", "split", "split", value=7)
place("twins", "split", "into", value=[1, 1])
place("children swapped", "split", "into", value=[2, 1])
place("child named as its parent", "split", "into", value=[0, 1])
place("split along an unknown too many", "split", "unknown", value=8)
# the exclusion
place("wrong part excluded", "exclude", "exclude", value=2)
place("whole box excluded", "exclude", "exclude", value=0)
place("excluded cap below that of the claims", "exclude", "cap", value=lambda text: moved(text, DOWN))
place("excluded cap above that of the problem", "exclude", "cap", value=lambda text: moved(text, UP))
place("excluded without weights", "exclude", "weights", value={"rows": [], "products": [], "tangents": [],
                                                              "exponents": [0, 0, 0]})  # fmt: skip
PRODUCT = [[0, 1, 1, 1, 1]]  # rows alone exclude a box whatever their common factor
place("excluded, rows very light", "exclude", "weights",
      value=lambda w: {**w, "products": PRODUCT, "exponents": [-1000, 0, 0]})  # fmt: skip
place("excluded, products very heavy", "exclude", "weights",
      value=lambda w: {**w, "products": PRODUCT, "exponents": [*w["exponents"][:1], 999, 0]})  # fmt: skip
# the pass
place("weight of a row 2^60", "pass", *WEIGHTS, "rows", 0, 1, value=1 << 60)
place("weight of a product -1", "pass", *WEIGHTS, "products", value=[[0, 1, 1, 1, -1]])
place("weight of a tangent -1", "pass", *WEIGHTS, "tangents", value=[[0, "0x0p+0", -1]])
for bad in (1000, -1001):
    place(f"exponent {bad}", "pass", *WEIGHTS, "exponents", 1, value=bad)
place("exponent of the rows one less", "pass", *WEIGHTS, "exponents", 0, value=lambda e: e - 1)
place("heaviest weight of a row", "pass", *WEIGHTS, "rows", 0, 1, value=(1 << 60) - 1)
place("weight of a row a quarter less", "pass", *WEIGHTS, "rows", 0, 1, value=lambda w: w - w // 4)
place("row dropped", "pass", *WEIGHTS, "rows", value=lambda rows: rows[1:])
place("upper is lower", "pass", *ROW, 0, value=lambda s: {"upper": "lower"}.get(s, "upper"))
place("row of another measurement", "pass", *ROW, 1, value=lambda k: (k + 1) % 6)
place("row after the last", "pass", *ROW, 1, value=13)
place("row of no side", "pass", *ROW, 0, value="middle")
place("side of constraints in a leg", "pass", *ROW, 0, value="sign", kinds=LEG)
place("side of a leg in constraints", "pass", *ROW, 0, value="length", kinds=NETWORK)
place("weight of a row after the last", "pass", *WEIGHTS, "rows", 0, 0, value=10_000)
place("weights of other rows", "pass", *WEIGHTS, "rows",
      value=lambda rows: [[n, w] for (n, _), (_, w) in zip(rows, [*rows[1:], rows[0]], strict=True)])  # fmt: skip
place("rows left out, weights kept", "pass", "rows", value=[])
place("product with p = 2", "pass", *WEIGHTS, "products", value=[[0, 1, 2, 1, 9]])
place("product with q = 0", "pass", *WEIGHTS, "products", value=[[0, 1, 1, 0, 9]])
place("product of an unknown too many", "pass", *WEIGHTS, "products", value=[[0, 8, 1, 1, 9]])
place("tangent of an unknown too many", "pass", *WEIGHTS, "tangents", value=[[8, "0x0p+0", 9]])
place("bound of an unknown too many", "pass", "bounds", 0, 0, value=8)
place("bound on no side", "pass", "bounds", 0, 1, value="both")
place("bound on the other side", "pass", "bounds", 0, 1, value=lambda s: {"lo": "hi"}.get(s, "lo"))
place("bound one ulp beyond", "pass", "bounds", 0, 2, value=lambda t: moved(t, UP))
place("bound at a huge number", "pass", "bounds", 0, 2, value="0x1p+9999")
place("pass on a closed box", "pass", "pass", value=1)
place("pass on a split box", "pass", "pass", value=0)
place("pass with a cap below that of the claims", "pass", "cap", value=lambda text: moved(text, DOWN))
place("pass without a cap", "pass", "cap", value=None)
place("pass without bounds", "pass", "bounds", value=[], refused="last")
# the second split
place("names used before", "halve", "into", value=[1, 2])
place("names left out", "halve", "into", value=[4, 5])
place("cut outside the box", "halve", "at", value="0x1p+20")
# readings
place("six signs", "pass", *ROW, 2, value=lambda t: t[:6], kinds=GAIN)
place("eight signs", "pass", *ROW, 2, value=lambda t: t + "0", kinds=GAIN)
place("signs that are none", "pass", *ROW, 2, value=lambda t: t[:6] + "1", kinds=GAIN)
place("opposite signs", "pass", *ROW, 2, value=lambda t: t.translate(str.maketrans("+-", "-+")), kinds=GAIN)
place("signs left out", "pass", *ROW, value=lambda row: row[:2], kinds=GAIN)
place("signs of exact constraints", "pass", *ROW, value=lambda row: [*row, "+++++++"], kinds=NETWORK)
place("opposite readings of the point", "claims", "point", "readings",
      value=lambda r: [t.translate(str.maketrans("+-", "-+")) for t in r], kinds=GAIN)  # fmt: skip
place("centres for readings of the point", "claims", "point", "readings", value=None, kinds=GAIN)
place("a reading of the point too few", "claims", "point", "readings", value=lambda r: r[1:], kinds=GAIN)
place("signs of readings of constraints", "claims", "point", "readings", value=lambda _: ["+"] * 14, kinds=NETWORK)
# constraints
place("objective too many", "header", "objective", value=4, kinds=NETWORK)
place("another objective", "header", "objective", value=0, refused="claims", kinds=NETWORK)
place("no objective, but a cap", "header", "objective", value=None, refused="claims", kinds=NETWORK)
place("an unknown twice", "header", "unknowns", value=lambda v: [v[0], *v[:-1]], kinds=NETWORK)
place("no unknowns", "header", "unknowns", value=[], kinds=NETWORK)
place("one constraint more than there are", "header", "constraints", value=lambda n: n + 1, refused="claims",
      kinds=NETWORK)  # fmt: skip
place("too many constraints", "header", "constraints", value=100_001, kinds=NETWORK)
place("a monomial unsorted", "constraint", "body", 0, 0, value=[1, 0], kinds=NETWORK)
place("a monomial of degree 9", "constraint", "body", 0, 0, value=[0] * 9, kinds=NETWORK)
place("a monomial of an unknown too many", "constraint", "body", 0, 0, value=[4], kinds=NETWORK)
place("a monomial twice", "constraint", "body", value=lambda p: [*p, p[0]], kinds=NETWORK)
place("a bound impossible", "constraint", "at_most", value=[[[], "-0x1p+0"]], refused="claims", kinds=NETWORK)


# constraints and steps that are changed, dropped or doubled -----------------------------------------------------------


def used(lines: Lines, proof: Any, side: str) -> dict[str, Any]:
    """A constraint that counts for the bound on the objective, with that side."""
    step = lines[proof.index("pass")]
    rows = [step["rows"][n] for n, _ in step["bounds"][0][3]["rows"]]
    return next(lines[1 + k] for s, k in rows if s == side and lines[1 + k]["root"])


def doubled(lines: Lines, k: int) -> None:
    lines.insert(k, lines[k])


def looser(term: list[Any], towards: float) -> None:
    term[1] = moved(term[1], towards)


def without_point(lines: Lines, proof: Any) -> Lines:
    lines[proof.head]["point"] = lines[proof.head]["epsilon"]["hi"] = None
    return lines


def former(lines: Lines, proof: Any) -> None:
    old = lines[proof.head]
    new = {"cap": old["cap"], "eps_lo": old["epsilon"]["lo"], "enclosure": old["enclosure"], "eps_hi": old["cap"]}
    lines[proof.head] = new


def no_objective(lines: Lines, proof: Any, *also: str) -> None:
    lines[0]["objective"] = None
    lines[proof.head].update(dict.fromkeys(("cap", *also)))


def weight_left_out(lines: Lines, proof: Any) -> None:
    step = lines[proof.index("exclude")]
    k = step["rows"][step["weights"]["rows"][0][0]][1]
    lines[0]["only"] = [n for n in range(lines[0]["measurements"]) if n != k]


def judged_by_one_left_out(lines: Lines, proof: Any, **point: Any) -> None:
    lines[0]["only"] = list(range(lines[0]["measurements"] - 1))
    lines[proof.head]["point"].update(point)


def roots_and_squares_swapped(lines: Lines, proof: Any) -> None:
    for line in lines[1 : proof.head]:
        line["root"] = not line["root"]


def no_gain(lines: Lines, proof: Any) -> None:
    """No gain in the claims, any gain in the problem."""
    for side in ("lo", "hi"):
        lines[proof.head]["enclosure"][side][7] = "0x0p+0"


def point_judged(lines: Lines, proof: Any, eps: float, judged: Callable[[list[Any]], dict[str, Any]]) -> None:
    """The claim of a point with another eps, by the rows that it fails at, None where it holds."""
    x = [*proof.point[:-1], eps]
    rows = [proof.fails(k, x) for k in range(proof.problem.count)]
    lines[proof.head]["epsilon"]["hi"] = None
    point = {"at": [v.hex() for v in x], "holds": [], "readings": None, "factor": None, "fails": []}
    lines[proof.head]["point"] = point | judged(rows)


def fails_where_it_holds(rows: list[Any]) -> dict[str, Any]:
    bad = next(row for row in rows if row)
    return {"fails": [[bad[0], rows.index(None), *bad[2:]]]}


def fails_twice(rows: list[Any]) -> dict[str, Any]:
    """Counts of what a point fails are made of these rows."""
    bad = next([row[0], k, *row[2:]] for k, row in enumerate(rows) if row)
    return {"fails": [bad, bad]}


def for_all_readings(lines: Lines, proof: Any, scale: float = 1.0, **changes: Any) -> None:
    """The true claim for all readings of sets with a part of the half-widths, and what is changed of it."""
    every = all_readings(proof.problem, proof.point[:-1])
    at = [*proof.point[:-1], every.least_eps(scale)]
    claims = with_readings(proof.problem, lines[proof.head] | {"point": claimed(None, point=at, factor=scale)["point"]})
    claims["epsilon"]["hi"] = None
    lines[proof.head] = claims
    for key, value in changes.items():
        claims["point"][key] = value(claims["point"][key]) if callable(value) else value


def at(k: int, value: Callable[[float], float]) -> Callable[[list[str]], list[str]]:
    """A coordinate of a point changed."""
    return lambda x: [value(valued(c)).hex() if i == k % len(x) else c for i, c in enumerate(x)]


def attained_by_all(lines: Lines, proof: Any) -> None:
    """An upper bound by a claim for all readings, which is another claim."""
    for_all_readings(lines, proof, 0.5)
    eps = lines[proof.head]["point"]["at"][-1]
    lines[proof.head]["epsilon"]["hi"] = lines[0]["hi"][-1] = eps


# the line that must be refused: by its name, or counted from the first one or from the claims
of_network: Changes = {
    "one constraint less than there are": (HEAD - 1, lambda a, p: a[0].update(constraints=a[0]["constraints"] - 1)),
    "a constraint dropped": (HEAD - 1, lambda a, p: a.pop(1)),  # the claims, where a constraint is due
    "no objective but epsilon": ("claims", no_objective),
    "no objective but caps of steps": ("exclude", lambda a, p: no_objective(a, p, "epsilon")),
    "roots and squares swapped": ("claims", roots_and_squares_swapped),
    "a coefficient one ulp looser above": ("pass", lambda a, p: looser(used(a, p, "upper")["body"][0], DOWN)),
    "a coefficient one ulp looser below": ("pass", lambda a, p: looser(used(a, p, "lower")["body"][0], UP)),
    "a bound one ulp looser": ("pass", lambda a, p: looser(used(a, p, "upper")["at_most"][0], UP)),
    "an upper bound dropped": ("pass", lambda a, p: used(a, p, "upper").update(at_most=None)),
    "a lower bound dropped": ("pass", lambda a, p: used(a, p, "lower").update(at_least=None)),
    "a square for a root": (  # of one constraint only, and without the point, which sees it first
        "exclude",
        lambda a, p: used(without_point(a, p), p, "lower").update(root=False),
    ),
}
of_a_leg: Changes = {
    "a weight on a measurement left out": ("exclude", weight_left_out),
    "a measurement left out judges the point": (
        "claims", lambda a, p: judged_by_one_left_out(a, p, holds=list(range(a[0]["measurements"])))),
    "a measurement left out refutes the point": (
        "claims", lambda a, p: judged_by_one_left_out(
            a, p, at=["0x1p+20"] * 8, holds=[], fails=[["upper", a[0]["measurements"] - 1]])),
    "rows of another leg without a point": ("exclude", lambda a, p: without_point(a, p)[0].update(leg=2)),
}  # fmt: skip
of_gain: Changes = {
    "the header of version 3": ("header", lambda a, p: (a[0].update(format="cpcal-certificate/3"), a[0].pop("model"))),
    "a proof of the plain model for the gain model": ("last", no_gain),
}
FALSE: dict[str, dict[str, Any]] = {
    "eps below that of all readings": {"at": at(-1, lambda e: e * (1.0 - 1e-9))},
    "all readings of larger sets": {"factor": "0x1.01p+0"},
    "all readings by a point moved": {"at": at(0, lambda c: c + 1.0)},
    "all readings with a negative length": {"at": at(6, lambda c: -c - 4096.0)},
    "all readings with a negative eps": {"at": at(-1, lambda e: -e)},
    "a factor of two": {"factor": "0x1p+1"},
    "a negative factor": {"factor": "-0x1p-1"},
}
for_all: Changes = {
    name: ("claims", lambda a, p, changes=changes: for_all_readings(a, p, **changes)) for name, changes in FALSE.items()
}  # fmt: skip
of_gain |= {
    "eps hi of a claim for all readings": ("claims", attained_by_all),
    "a factor too large": ("claims", lambda a, p: for_all_readings(a, p, 0.5, factor="0x1.02p-1")),
    "a point that holds for some readings alone": (
        "claims", lambda a, p: (
            a[p.head]["epsilon"].update(hi=None), a[p.head]["point"].update(factor="0x1p+0", readings=None))),
    "all readings and some that are named": (
        "claims", lambda a, p: for_all_readings(a, p, readings=["0" * 7] * p.problem.count)),
}  # fmt: skip
of_both: Changes = {
    "the point holds where it fails": (
        "claims", lambda a, p: point_judged(
            a, p, 0.0, lambda rows: {"holds": [next(k for k, row in enumerate(rows) if row)]})),
    "the point fails where it holds": ("claims", lambda a, p: point_judged(a, p, p.eps_hi / 2, fails_where_it_holds)),
    "the point fails twice at one measurement": ("claims", lambda a, p: point_judged(a, p, p.eps_hi / 2, fails_twice)),
    "the point judged by all but one": (
        "claims", lambda a, p: a[p.head]["point"].update(holds=list(range(1, p.problem.count)))),
    "the point outside the box": (
        "claims", lambda a, p: a[0]["hi"].__setitem__(0, moved(a[p.head]["point"]["at"][0], DOWN))),
    "excluded part too large": ("exclude", lambda a, p: a[p.index("split")].update(at=a[0]["hi"][-1])),
    "split along another unknown": ("exclude", lambda a, p: a[p.index("split")].update(unknown=0, at=a[0]["lo"][0])),
    "claims of the former format": ("claims", former),
    "pass and exclude in one": ("pass", lambda a, p: a[p.index("pass")].update(exclude=2)),
    "no step at all": ("pass", lambda a, p: a.__setitem__(p.index("pass"), {"because": "I say so"})),
    "point as a last step": ("last", lambda a, p: a.append({"point": a[p.head]["point"]["at"]})),
    "claims twice": ("split", lambda a, p: doubled(a, p.head)),
    "header twice": (1, lambda a, p: doubled(a, 0)),
    "claims first": ("header", lambda a, p: a.insert(0, a.pop(p.head))),
    "split dropped": ("split", lambda a, p: a.pop(p.index("split"))),
    "split twice": ("exclude", lambda a, p: doubled(a, p.index("split"))),
    "leaf dropped": ("last", lambda a, p: a.pop(p.index("exclude"))),
    "exclusion twice": ("pass", lambda a, p: doubled(a, p.index("exclude"))),
    "pass dropped": ("last", lambda a, p: a.pop(p.index("pass"))),
    "no claims": ("claims", lambda a, p: a.__delitem__(slice(p.head, None))),
    "no steps": ("last", lambda a, p: a.__delitem__(slice(p.head + 1, None))),
}  # fmt: skip
for kinds, changes in (
    (NETWORK, of_network), (LEG, of_a_leg), (GAIN, of_gain), (BOTH, of_both), ((*LEG, *GAIN), for_all)
):  # fmt: skip
    FORGERIES |= {name: (where, change, kinds) for name, (where, change) in changes.items()}
