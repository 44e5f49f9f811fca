"""Leg models: their equations, fits and certificates against independent formulas; what is refused."""

import math
from dataclasses import replace
from fractions import Fraction as F

import numpy as np
import pytest

import cpcal
from cpcal.files import campaign_sha256
from cpcal.models import PLAIN, ModelResiduals, leg, leg_box, leg_model, leg_network, model_residuals, model_statement
from cpcal.models.leg import sag_shape
from cpcal.robot import ModelChoice, Pose, leg_vectors, rotation_matrix
from cpcal.solver.network import ConstraintNetwork, Tape, sqr
from cpcal.solver.optimize.witness import verify_point
from tests.changed import some, with_gain
from tests.checker.proofs import applied, rotation_of

NAMES = ("plain", "gain", "lateral")


@pytest.fixture(scope="module")
def exact():
    return with_gain(cpcal.simulate(seed=1, factor=0.0), 0.01)


@pytest.fixture(scope="module")
def uncertain():
    """Noise stays within the sets, so that the truth solves every equation of the gain model."""
    return with_gain(cpcal.simulate(seed=1, factor=3.0, truncate=2.9), 0.01)


def independent(campaign, leg, x, name):
    """g (N,) by its formula, in numpy."""
    rotation, length = rotation_matrix(campaign.quaternion), campaign.length[:, leg - 1]
    v = campaign.position + rotation @ x[3:6] - x[:3]
    square, reading = (v**2).sum(axis=1), length + x[6]
    if name == "gain":
        reading = reading + x[7] * length
    if name == "lateral":
        square = square - x[7]
    return np.sqrt(square) - reading


def about(campaign, leg, model, seed=0):
    """A point near the nominal one, extra parameters anywhere in their box."""
    rng = np.random.default_rng(seed)
    near = campaign.robot.parameters[leg - 1] + rng.normal(size=7)
    return np.append(near, model.half_widths * rng.uniform(-1.0, 1.0, len(model.extra)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", ["exact", "uncertain"])
def test_residuals_are_the_formula_and_their_derivatives_its_slopes(request, kind, name):
    campaign, model = request.getfixturevalue(kind), leg_model(name)
    x = about(campaign, 2, model)
    expected = independent(campaign, 2, x, name)
    np.testing.assert_allclose(model_residuals(campaign, 2, x, model), expected, rtol=0, atol=1e-9)
    of, step = ModelResiduals(campaign, 2, model), 1e-5
    slopes = [
        (independent(campaign, 2, x + e, name) - independent(campaign, 2, x - e, name)) / (2 * step)
        for e in step * np.eye(len(x))
    ]
    np.testing.assert_allclose(of.jacobian(x), np.transpose(slopes), rtol=1e-5, atol=1e-5)


def test_the_box_of_a_leg_holds_all_within_its_half_width():
    rng = np.random.default_rng(4)
    center, delta = rng.uniform(-500.0, 500.0, 7), 0.1
    box = leg_box(center, delta)
    for value, lo, hi in zip(center.tolist(), box.lo.tolist(), box.hi.tolist(), strict=True):
        assert F(lo) <= F(value) - F(delta)
        assert F(value) + F(delta) <= F(hi)


def test_a_leg_is_longer_than_eps_for_every_reading_of_its_length():
    campaign = cpcal.simulate(seed=1, extremal=False, random_poses=9)
    k = int(np.argmin(campaign.length[:, 0] - campaign.length_radius[:, 0]))
    eps, shortest = 50.0, campaign.length[k, 0] - campaign.length_radius[k, 0]
    # the joints are eps apart, so that the equation itself holds to within eps
    for more, holds in ((-1e-6, False), (1e-6, True)):
        x = np.array([*(campaign.position[k] - [eps, 0.0, 0.0]), 0.0, 0.0, 0.0, eps - shortest + more])
        network = leg_network(campaign, 1, leg_box(x, 0.0), eps=(eps, eps))
        assert bool(verify_point(network, np.append(x, eps)).holds[k]) is holds


def value(given, at):
    """A stated polynomial at a point, in fractions."""
    return sum((c * math.prod((at[i] for i in monomial), start=F(1)) for monomial, c in given), F(0))


@pytest.mark.parametrize("name", NAMES[1:])
def test_a_certificate_states_the_equations_of_the_campaign_exactly(exact, name):
    """Every polynomial at a rational point against the formula in fractions, from the campaign's numbers.

    The same models under user-defined names, which the checker does not know.
    """
    model, leg = replace(leg_model(name), name=f"own_{name}"), 4
    campaign = some(exact, slice(0, 5))
    x = about(campaign, leg, model)
    net = leg_network(campaign, leg, leg_box(x, 100.0, model), eps=(0.0, 9.0), model=model)
    statement = model_statement(campaign, leg, model, net.domain)
    assert statement is not None
    at = tuple(F(float(v)) for v in [*x, 0.3125])
    a, b, (offset, *extra), eps = at[:3], at[3:6], at[6:-1], at[-1]
    for k, item in enumerate(statement.items[:5]):
        quaternion = [F(float(v)) for v in campaign.quaternion[k]]
        position, length = [F(float(v)) for v in campaign.position[k]], F(float(campaign.length[k, leg - 1]))
        size, turned = sum((c * c for c in quaternion), F(0)), applied(rotation_of(quaternion), b)
        v = [position[i] + turned[i] - a[i] for i in range(3)]
        square, reading = sum(c * c for c in v), length + offset
        if name == "lateral":
            square -= extra[0]
        else:
            reading += extra[0] * length
        assert item.root
        assert value(item.body, at) == size**2 * square
        assert value(item.at_most, at) == size * (reading + eps)
        assert value(item.at_least, at) == size * (reading - eps)
    for k, item in enumerate(statement.items[5:]):
        length = F(float(campaign.length[k, leg - 1]))
        assert value(item.body, at) - value(item.at_least, at) == offset + length - eps


# a user-defined model -----------------------------------------------------------------------------------------


@pytest.fixture
def cubic():
    """A bend of the sensor's scale, of second order in its reading."""
    bend = cpcal.Parameter("bend", "1/mm", 1e-4)
    return cpcal.LegModel("bent", "L + l + bend L^2", (bend,), lambda m, x: x["bend"] * sqr(m.length))


def test_a_model_of_ones_own_is_certified_and_checked(exact, cubic, tmp_path):
    campaign = replace(exact, length=exact.length - 2e-5 * exact.length**2)
    result = cpcal.certify(campaign, legs=[1], model=cubic, certificates=tmp_path)
    leg = result.legs[0]
    assert result.model.parameters[7:] == ("bend",)
    assert leg.bracket.certificate == "leg1.cert.jsonl"
    from cpcal.checker import check

    accepted = check(tmp_path / leg.bracket.certificate)
    assert float(accepted.claims.eps_lo) == leg.bracket.lo
    assert float(accepted.claims.eps_hi) == leg.bracket.hi
    assert accepted.unknowns[-2:] == ("bend", "eps")
    assert leg.bracket.hi < cpcal.certify(campaign, legs=[1]).legs[0].bracket.lo


def test_what_cannot_be_a_model_is_refused_with_everything_that_is_wrong():
    with pytest.raises(cpcal.InputError) as refused:
        leg_model(cpcal.LegModel("gain", "nothing"))
    assert len(refused.value.problems) == 2
    bad = (cpcal.Parameter("l", "mm", 1.0), cpcal.Parameter("x y", "mm", -1.0))
    with pytest.raises(cpcal.InputError) as refused:
        leg_model(cpcal.LegModel("my model", "?", bad, lambda m, x: m.length))
    assert len(refused.value.problems) == 4


# what is asked ------------------------------------------------------------------------------------------------


def test_unknown_models_and_parameters_are_refused_with_all_other_problems(exact):
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.certify(exact, legs=[9], model="gian", delta=-1.0)
    assert [p.where for p in refused.value.problems] == ["model", "legs", "delta"]
    assert "plain, gain, lateral" in str(refused.value)
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.certify(exact, model="gain", half_widths={"t": 1.0, "s": float("nan")}, gap=2.0)
    assert [p.where for p in refused.value.problems] == ["half_widths", "half_widths", "gap"]
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.compare(exact, ["plain", "plain", "gian"], tolerance=-1.0, half_widths={"lateral": {}}, center="fit")
    assert [p.where for p in refused.value.problems] == ["models", "half_widths", "center", "tolerance", "model"]
    with pytest.raises(cpcal.InputError, match="none is named"):
        cpcal.compare(exact, [])


def test_the_table_model_of_a_campaign_comes_back_and_is_asked_for(exact, tmp_path):
    choice = ModelChoice("gain", {"s": 0.002})
    campaign = replace(some(exact, slice(0, 12)), model=choice)
    cpcal.save_campaign(campaign, tmp_path / "c")
    again = cpcal.load_campaign(tmp_path / "c")
    assert again == campaign
    assert campaign_sha256(again) == campaign_sha256(campaign)
    assert again != replace(campaign, model=None)
    result = cpcal.certify(again, legs=[1])
    assert result.model.name == "gain"
    assert result.model.extra[0].half_width == 0.002
    assert abs(result.legs[0].bracket.enclosure["s"].hi) <= 0.002
    assert cpcal.certify(again, legs=[1], model="plain").model.parameters == PLAIN.parameters
    assert cpcal.certify(again, legs=[1], half_widths={"s": 0.0}).legs[0].bracket.point[7] == 0.0
    # another model's half-widths are its own
    assert cpcal.certify(again, legs=[1], model="lateral").model.extra[0].half_width == 900.0


@pytest.mark.parametrize(
    ("table", "count", "said"),
    [
        ("[model]\n", 1, "the key 'name' is missing in [model]"),
        ("[model]\nname = 3\nwidth = 4\n", 2, "unknown key 'width'"),
        ('[model]\nname = "two words"\nhalf_widths = 3\n', 2, "half_widths is not a table"),
        ('[model]\nname = "gain"\nhalf_widths = { s = -1, "t u" = "x", v = inf }\n', 4, "negative number -1"),
        ("model = 3\n", 1, "is not a section"),
    ],
)
def test_bad_tables_are_refused_with_their_lines(exact, tmp_path, table, count, said):
    cpcal.save_campaign(some(exact, slice(0, 3)), tmp_path)
    toml = tmp_path / "campaign.toml"
    text = toml.read_text(encoding="utf-8")
    toml.write_text(text + table if table.startswith("[") else table + text, encoding="utf-8")
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.load_campaign(tmp_path)
    assert len(refused.value.problems) == count
    assert said in str(refused.value)
    first = 1 if table.startswith("model") else text.count("\n") + 1
    assert all(p.line is not None and p.line >= first for p in refused.value.problems)


def test_a_reading_turns_a_leg_by_the_whole_rotation_however_large():
    rng = np.random.default_rng(1)
    net, arms, s = ConstraintNetwork(), rng.normal(size=(7, 3)), rng.uniform(-0.5, 0.5, (7, 3))
    v = net.variable("v", 3)
    expr = leg.turned_rows(net.reading(np.zeros((7, 3)), np.full((7, 3), 0.5)), arms + v)
    tape = Tape(net, [expr])
    turned = tape.near(np.zeros((1, 3)), s.ravel())[0, tape.program.roots].reshape(7, 3)
    quaternion = np.column_stack([np.ones(7), s])
    quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
    np.testing.assert_allclose(turned, (rotation_matrix(quaternion) @ arms[..., None])[..., 0], atol=1e-14)


# the leg model `sag` ---------------


@pytest.fixture(scope="module")
def perfect():
    return cpcal.simulate(seed=1, factor=0.0, deviation=0.0, noise=0.0)


def bent(campaign, c):
    """The same poses read by the sensors of legs that sag by c mm: longer by what is lost."""
    length, robot = campaign.length.copy(), campaign.robot
    vector = leg_vectors(robot, Pose(campaign.position, campaign.quaternion))
    for _ in range(30):
        middle = robot.offset + 0.5 * (length.min(axis=0) + length.max(axis=0))
        shape = sag_shape(vector, length + robot.offset, middle, np.array([0.0, 0.0, 1.0]))
        length = campaign.length + c * shape
    return replace(campaign, length=length)


def test_proofs_enclose_it(perfect):
    found = cpcal.compare(bent(perfect, 2.0), ["plain", "sag"], legs=[3], tolerance=0.1)
    assert [cpcal.verdict_of(result, result.legs[0]).word for result in found.values()] == ["fail", "not compared"]
    assert found["sag"].legs[0].bracket.hi <= 0.1
    assert 2.0 in found["sag"].legs[0].bracket.enclosure["c"]


# models of other packages: found by entry point, in this process and in every other one ---------------

MODULE = """
from cpcal import LegModel, Parameter
stretched = LegModel("stretched", "L + l + k", (Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
misnamed = stretched
shadowing = LegModel("plain", "L + l + k", (Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
"""
POINTS = """[cpcal.leg_models]
stretched = others:stretched
broken = absent:model
other = others:misnamed
plain = others:shadowing
"""


@pytest.fixture
def other_package(tmp_path, monkeypatch):
    """A folder on sys.path that holds an installed package with four leg models, only one of which is usable."""
    metadata = tmp_path / "others-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    (tmp_path / "others.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_a_broken_or_misnamed_entry_point_is_refused_with_what_it_names(other_package):
    with pytest.raises(cpcal.PluginError, match=r"leg model 'broken' \(absent:model\) does not load"):
        leg_model("broken")
    with pytest.raises(cpcal.PluginError, match=r"'other' \(others:misnamed\) is no cpcal.LegModel of that name"):
        leg_model("other")


def test_a_term_of_the_wrong_kind_is_refused_when_it_is_used(exact, cubic):
    for wrong in (lambda m, x: m.position * x["bend"], lambda m, x: 1.0):
        with pytest.raises(cpcal.ModelError, match=r"'bent' must give an expression of shape \(64,\)"):
            cpcal.certify(exact, legs=[1], model=replace(cubic, term=wrong))
