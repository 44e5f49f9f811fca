"""AMPL's .nl: what its segments mean, and what is wrong has its line; answers as JSON and .sol."""

import json
import random
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cpcal.cli.app import app
from cpcal.common.errors import InputError
from cpcal.problems.nl import read_nl
from cpcal.problems.problem import answer
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.interval import Box
from cpcal.solver.network import evaluate

# minimise x0 x3 (x0 + x1 + x2) + x2 with x0 x1 x2 x3 >= 25 and x0^2 + x1^2 + x2^2 + x3^2 = 40, 1 <= x <= 5 (hs071);
# the sum of squares by a common expression, products as a binary tree
HS071 = Path(__file__).with_name("hs071.nl").read_text(encoding="utf-8")
PIECES = ["", "o5", "v99", "n1e999", "C0", "r", "b", "-3", "\0", "x4", "9" * 400]
AT = [1.0, 4.75, 3.8, 1.375]


def values(text: str, at: list[float]) -> list[float]:
    """Of the objective and of the constraints' bodies."""
    problem = read_nl(text, "problem.nl")
    network, box = problem.network, Box(problem.network.names, at, at)
    bodies = [problem.objective, *(c.body for c in network.constraints)]
    return [float(evaluate(network, body, box).mid) for body in bodies if body is not None]


def test_a_problem_is_what_its_segments_say() -> None:
    found = values(HS071, AT)
    x0, x1, x2, x3 = AT
    wanted = [x0 * x3 * (x0 + x1 + x2) + x2, x0 * x1 * x2 * x3, x0**2 + x1**2 + x2**2 + x3**2]
    assert found == pytest.approx(wanted, rel=1e-14)
    problem = read_nl(HS071, "problem.nl")
    assert not problem.maximize
    assert [float(problem.network.domain[name].hi) for name in problem.network.names] == [5.0] * 4
    lower = [float(c.lower.data.lo) for c in problem.network.constraints]
    assert lower == [25.0, 40.0]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("g3", "b3", "is no text form of .nl"),
        (" 4 2 1", " 4 two 1", "no whole number"),
        ("0 0 0 0 0\t# discrete", "0 0 2 0 0\t# discrete", "has whole-number variables"),
        ("o54\n3", "o99\n3", "o99 is not understood"),
        ("v0\nn2", "v9\nn2", "names the variable 9"),
        ("n2\no77", "nan\no77", "is not understood here"),
        ("o77\nv1", "h77\nv1", "begins no expression"),
        ("r\n2 25", "r\n5 25", "no bounds that are understood"),
        ("k3\n2", "Z3\n2", "begins no segment"),
    ],
)
def test_what_is_wrong_has_its_line(old: str, new: str, what: str) -> None:
    text = HS071.replace(old, new, 1)
    with pytest.raises(InputError) as caught:
        read_nl(text, "problem.nl")
    (problem,) = caught.value.problems
    assert what in problem.what
    assert problem.where == "problem.nl"
    pairs = zip(HS071.splitlines(), text.splitlines(), strict=True)
    first = next(k for k, (was, line) in enumerate(pairs) if was != line)
    assert problem.line == first + 1


def test_mutated_files_end_in_a_line() -> None:
    rng = random.Random(3)
    lines = HS071.splitlines()
    refused = 0
    for _ in range(500):
        mutated = list(lines)
        for _ in range(rng.randrange(1, 4)):
            k = rng.randrange(len(mutated))
            mutated[k : k + rng.randrange(2)] = [rng.choice(PIECES)]
        try:
            read_nl("\n".join(mutated), "problem.nl")
        except InputError as error:
            refused += 1
            lost = [p for p in error.problems if not p.line]
            if lost:
                pytest.fail(f"without a line: {lost}")
    assert refused > 200


def test_the_command_writes_json_and_sol(tmp_path: Path) -> None:
    (tmp_path / "two.bch").write_text("Variables x in [-3,3]; y in [-3,3]; Constraints x^2 = 2; y = x; end")
    run = CliRunner().invoke(app, ["solve", str(tmp_path / "two.bch"), "-o", str(tmp_path / "two.json")])
    assert run.exit_code == 0, run.output
    assert "exactly one" in run.output
    said = json.loads((tmp_path / "two.json").read_text())
    assert (said["format"], said["status"], said["objective"]) == ("cpcal-solution/1", "complete", None)
    assert said["method"].rstrip(".") in " ".join(run.output.split())
    assert said["width"] == 1e-6
    assert [s["status"] for s in said["solutions"]] == ["proved", "proved"]
    roots = sorted(s["box"]["x"][0] for s in said["solutions"])
    assert roots == pytest.approx([-(2**0.5), 2**0.5])
    (tmp_path / "h.nl").write_text(HS071)
    written = ["solve", str(tmp_path / "h.nl"), "-o", str(tmp_path / "h.sol")]
    run = CliRunner().invoke(app, written)
    assert run.exit_code == 0, run.output
    assert (tmp_path / "h.sol").read_text().rstrip().endswith("objno 0 0")
    run = CliRunner().invoke(app, [*written, "--time-limit", "0"])
    assert run.exit_code == 1, run.output
    assert (tmp_path / "h.sol").read_text().rstrip().endswith("objno 0 400")
    for wrong in ("h.txt", "h.toml"):
        assert CliRunner().invoke(app, ["solve", str(tmp_path / "h.nl"), "-o", str(tmp_path / wrong)]).exit_code == 2


def test_a_largest_value_has_its_signs_turned() -> None:
    text = HS071.replace("O0 0", "O0 1")
    problem = read_nl(text, "problem.nl")
    assert problem.maximize
    found = answer(problem, limits=Limits(nodes=3, gap=1e-15, gap_absolute=0.0))
    assert found.objective is not None
    assert found.objective[1] >= 17.014  # the largest is not below the smallest
    assert found.verdict is Verdict.UNKNOWN


def test_a_stopped_search_goes_on_to_the_same_answer(tmp_path: Path) -> None:
    ring = "Variables x in [-2,2]; y in [-2,2]; Constraints x^2 + y^2 = 2; end"
    (tmp_path / "ring.mbx").write_text(ring)
    (tmp_path / "least.mbx").write_text(ring.replace("Constraints", "Minimize x + y; Constraints"))

    def solved(name: str, *options: str) -> int:
        arguments = ["solve", str(tmp_path / f"{name}.mbx"), "-o", str(tmp_path / f"{name}.json"), "--width", "0.05"]
        return CliRunner().invoke(app, [*arguments, *options]).exit_code

    def said() -> dict[str, object]:
        return {**json.loads((tmp_path / "ring.json").read_text()), "seconds": None}

    assert solved("ring") == 0
    whole = said()
    assert solved("ring", "--node-limit", "30") == 1
    assert (tmp_path / "ring.json.checkpoint").exists()
    assert solved("ring", "--resume") == 0
    assert said() == whole
    assert not (tmp_path / "ring.json.checkpoint").exists()
    assert solved("least", "--resume") == 0  # with no checkpoint there it begins anew
