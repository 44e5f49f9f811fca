"""The main job: a campaign in, for every leg a proved bracket of its smallest model error out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from cpcal.certify.leg import certify_leg
from cpcal.certify.model import chosen_model
from cpcal.certify.question import Progress, Question, check
from cpcal.errors import InputError, Problem
from cpcal.legs import LegModel
from cpcal.results import LegResult, ModelNote, Result
from cpcal.robot import Campaign
from cpcal.solver import plugins
from cpcal.solver.contract import Limits
from cpcal.solver.interval import get_arithmetic
from cpcal.version import __version__


def certify(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    delta: float = 100.0,
    center: str = "fit",
    gap: float = 1e-6,
    time_limit: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
    eps: float | None = None,
    support: str = "few",
    method: str = "bound",
    certificates: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    model: str | LegModel | None = None,
    half_widths: Mapping[str, float] | None = None,
) -> Result:
    """For every leg the smallest eps for which some x satisfies all N equations, bracketed by proofs.

    "Satisfies" means: for every measurement THERE EXISTS a reading in its set with `|g(x, M_k)| <= eps`.
    x ranges over all parameters within `delta` mm of the center: "fit" (least squares), "plain" (of the plain model) or
    "nominal". `legs` counts from 1 (default: all). `gap` is relative, `time_limit` in seconds per leg. With `eps` (mm)
    the question is instead whether S(eps) is empty. `progress` is called with (leg, Bracket) as the brackets shrink.

    `support` "irreducible" leaves out of each leg's support every measurement that the proof can do without; "few" does
    not try. `certificates` names a folder for `legN.cert.jsonl`, which prove the answers to `cpcal verify` (and
    `legN.support.cert.jsonl`, that an irreducible support alone proves eps_lo): then every step is proved once more
    in exact arithmetic before it counts, and only contractors that give weights take part, if there is one (lifted).

    `method` "bound" is branch and bound on eps; "timeout" is the script of the paper's section 5.2.1, which asks a
    solver made of the contractors for points at one eps after the other, and needs a `time_limit`.

    `model` is the leg model: "plain", "gain", "linear", "lateral", the name of one that an installed package provides,
    or a `LegModel` (default: the campaign's, else plain). Its extra parameters range within `half_widths` of 0: those
    given by name, else its own.

    Ctrl-C ends it with what is proved so far. Raises InputError, PluginError.
    """
    corrected, wrong = chosen_model(campaign, model, half_widths)
    check(campaign, legs, delta, center, gap, time_limit, eps, support, method, wrong)
    plugins.check_names(contractors)
    limits = Limits(seconds=time_limit, gap=gap)
    folder = None if certificates is None else emptied(Path(certificates), "leg*.cert.jsonl")
    engine = get_arithmetic(arithmetic)
    question = Question(
        campaign, delta, center, tuple(contractors), engine, eps, limits, support, method, folder, progress, corrected
    )
    return answered(question, legs or range(1, campaign.legs + 1))


def answered(question: Question, legs: Sequence[int]) -> Result:
    """The legs one after the other. Raises InputError when a certificate cannot be written."""
    campaign, model = question.campaign, question.model
    done: list[LegResult] = []
    interrupted = False
    for leg in legs:
        try:
            found, interrupted = certify_leg(question, leg)
        except KeyboardInterrupt:
            interrupted = True
            break
        except OSError as error:
            raise _unwritable(question.certificates, error) from None
        done.append(found)
        if interrupted:
            break
    return Result(
        campaign.robot.name,
        campaign.sha256,
        len(campaign),
        model.parameters,
        question.delta,
        question.center,
        question.limits.gap,
        question.eps,
        question.contractors,
        question.engine.name,
        __version__,
        tuple(done),
        interrupted,
        question.method,
        question.limits.seconds,
        question.support,
        ModelNote(model.name, model.summary, model.extra),
    )


def emptied(folder: Path, pattern: str) -> Path:
    """A folder for certificates, made if missing, without those of an earlier run. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob(pattern):
            old.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from None
    return folder


def _unwritable(folder: Path | None, error: OSError) -> InputError:
    remedy = "choose a folder that can be written to"
    return InputError([Problem(str(folder), f"cannot be written: {error.strerror or error}", remedy)])
