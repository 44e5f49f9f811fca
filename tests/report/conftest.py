"""Pages with legs of every kind, and of a whole study, for browsers and validators."""

import dataclasses
import math

import numpy as np
import pytest

import cpcal
from cpcal.models import PARAMETERS, Parameter
from cpcal.questions import ModelNote, Ranges, calibrate_study
from cpcal.questions.points import VerifiedFit
from cpcal.report import write_report
from cpcal.report.run_page import write_comparison
from cpcal.report.study_page import StudyFound, render_study
from cpcal.simulate import simulate_study, true_robot
from tests.changed import leg_with
from tests.report.made import made_leg, made_result


@pytest.fixture(scope="package")
def page(tmp_path_factory):
    """Six legs of every kind: proved, thin, wide, unbounded, empty, without a point; with long names."""
    campaign = cpcal.simulate(seed=1, joint_error=1.0)
    long = "Supercalifragilistic" * 8
    campaign = dataclasses.replace(
        campaign, robot=dataclasses.replace(campaign.robot, name=f"<b>{long}"), provenance={long: long}
    )
    nominal = campaign.robot.parameters

    def box(number, reach):
        x = nominal[number - 1]
        return cpcal.Box(PARAMETERS, x - reach, x + reach)

    def leg(number, reach, **changes):
        x = nominal[number - 1]
        point, ids = tuple(map(float, x)), tuple(campaign.measurement_ids)
        numbers = (0.089, 0.0890001, point, tuple(x + 1.5), box(number, reach), 0.0, ids, 1, 94, 0.25)
        return made_leg(number, *numbers, **changes)

    thin = box(1, np.array([3e-9, 4e-8, 1.234e-5, 0.00987, 1.0, 1.0, 1.0]))
    wide = box(2, np.array([0.0999, 1.0, 1234.5, 9.99e5, 1.0, 1.0, 1.0]))
    legs = (
        leg(1, 1e-7, ranges=Ranges(0.1, thin)),
        leg(2, 4.0, ranges=Ranges(0.0890001, wide)),
        leg(3, np.array([np.inf, 1.0, 2e3, 1.0, 1.0, 1.0, 1e9])),
        leg(4, 1.0, enclosure=cpcal.Box.empty(PARAMETERS), verdict=cpcal.Verdict.REFUTED, point=None, eps_hi=math.inf),
        leg(5, 100.0, verdict=cpcal.Verdict.UNKNOWN, point=None, eps_hi=math.inf, ranges=Ranges(0.2, box(5, 2.0))),
        leg(6, 0.0),
    )
    result = made_result(campaign, *legs)
    return write_report(campaign, result, tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="package")
def comparison(tmp_path_factory):
    """The page of compared models with legs of every kind; with long and hostile names."""
    campaign = cpcal.simulate(seed=1)
    robot = dataclasses.replace(campaign.robot, name="<b>" + "Supercalifragilistic" * 8)
    campaign = dataclasses.replace(campaign, robot=robot)
    extra = tuple(Parameter(f"c{k}", "mm", 1.0) for k in range(7))
    names = (*PARAMETERS, *(p.name for p in extra))

    def result(model, lo, hi, *, certified=False):
        box = cpcal.Box(names, [-1.0] * 14, [1.0] * 14) if hi < math.inf else cpcal.Box.empty(names)
        point = (0.0,) * 14 if hi < math.inf else None
        legs = [
            made_leg(
                leg, lo, hi, point, (0.0,) * 7, box, 0.0, (), 1, 9, 0.5,
                extra=(0.0,) * 7,
                certificate=f"leg{leg}.cert.jsonl" if certified else None,
                verdict=cpcal.Verdict.PROVED if hi < math.inf else cpcal.Verdict.UNKNOWN,
            )
            for leg in range(1, 7)
        ]  # fmt: skip
        fields = vars(made_result(campaign, tolerance=0.3, interrupted=True))
        return cpcal.Result(**fields | {"model": ModelNote(model, extra), "legs": tuple(legs)})

    found = {
        "plain": result("plain", 0.75045, 0.75046, certified=True),
        "lateral": result("lateral", 0.5, 0.5000001),
        "Supercalifragilistic" * 8: result("Supercalifragilistic" * 8, 0.1, math.inf),
        "gain": result("gain", 0.0, 0.0, certified=True),
    }
    return write_comparison(found, tmp_path_factory.mktemp("comparison"), stopped=True)


@pytest.fixture(scope="package")
def study():
    """A calibrated study with six legs as a solver might leave them; no solver is run."""
    simulated = simulate_study(seed=3, runs=3, validation_runs=2, random_poses=9, sag=2.0)
    found = calibrate_study(simulated)
    campaign, record = found.campaign, found.record

    def leg(number, **changes):
        x = found.x_c.parameters[number - 1]
        point, box = tuple(map(float, x)), cpcal.Box(PARAMETERS, x - 0.01, x + 0.02)
        support = tuple(campaign.measurement_ids[::9])
        made = made_leg(number, 0.0890117468, 0.0890117515, point, point, box, 0.0, support, 1, 94, 0.25)
        return leg_with(made, ranges=Ranges(0.1, box), **changes)

    perfect = leg(6, eps_lo=0.0, eps_hi=0.0)
    bound = made_result(campaign, *(leg(k) for k in range(1, 6)), perfect)
    open_ended = leg(5, verdict=cpcal.Verdict.UNKNOWN, point=None, eps_hi=math.inf)
    timeout = made_result(
        campaign, *(leg(k) for k in range(1, 5)), open_ended, perfect, method="timeout", time_limit=3.0
    )

    def verified(name, solutions):
        legs = [(k, (64, 0) if k in solutions else (12, 51)) for k in range(1, 7)]
        values = getattr(record, name).values
        return tuple(VerifiedFit(k, tuple(values[k - 1]), cpcal.VerifiedPoint(0.0, *counts, 64)) for k, counts in legs)

    fits = {"x_c": verified("x_c", ()), "x_c_sigma": verified("x_c_sigma", (6,))}
    said = "The checker accepted all 18 certificates (FLINT's exact rationals, no solver): 65 steps."
    return StudyFound(campaign, record, fits, bound, timeout, said, true_robot(campaign))


@pytest.fixture(scope="package")
def study_page(study, tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "report.html"
    path.write_text(render_study(study), encoding="utf-8")
    return path
