"""Models that are user-defined constraint networks, compared in the same way."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.files.run_folder import COMPARED, answers_into
from cpcal.questions import Comparison, Entry
from cpcal.solver.certificate.exact_network import NotStated
from cpcal.solver.contract import Limits
from cpcal.solver.execution.stopping import heard
from cpcal.solver.interval import Box
from cpcal.solver.model import Network
from cpcal.solver.network import Expr
from cpcal.solver.optimize.minimum import Minimum

Model = tuple[Network, Expr]  # a network, and its variable eps


def compare_networks(
    cases: Mapping[str, Mapping[str, Model]],
    *,
    title: str = "user-defined models",
    tolerance: float | None = None,
    contractors: Sequence[str] = ("lifted",),
    arithmetic: str = "float64",
    limits: Limits | None = None,
    certificates: str | os.PathLike[str] | None = None,
    progress: Callable[[Entry], None] | None = None,
) -> Comparison:
    """For each subject, and each of its models (network, eps), the smallest eps, bracketed by proofs.

    THERE EXISTS one value of every reading in its set, as in `Network.minimize`, whose arguments these are.
    `certificates` names a folder for files such as `A-linear.cert.jsonl`; networks with readings, or without polynomial
    form, have none: they stay unchecked. Raises InputError, and what `Network.minimize` raises.
    """
    _check(cases, tolerance)
    with heard(), ExitStack() as keep:
        folder = None if certificates is None else keep.enter_context(answers_into(certificates, COMPARED))
        ask = partial(Network.minimize, contractors=contractors, arithmetic=arithmetic, limits=limits)
        entries, interrupted = _compared(cases, ask, folder, progress)
    models = dict.fromkeys((m for models in cases.values() for m in models), "a user-defined network")
    return Comparison(title=title, tolerance=tolerance, models=models, entries=entries, interrupted=interrupted)


def _compared(
    cases: Mapping[str, Mapping[str, Model]],
    ask: Callable[..., Minimum],
    folder: Path | None,
    progress: Callable[[Entry], None] | None,
) -> tuple[tuple[Entry, ...], bool]:
    """The entries, and whether the user interrupted them."""
    entries: list[Entry] = []
    interrupted = False
    for subject, model, (net, eps) in ((s, m, case) for s, models in cases.items() for m, case in models.items()):
        path = None if folder is None else folder / f"{subject}-{model}.cert.jsonl"
        try:
            found = ask(net, eps, certificate=path, about=f"{subject}, model {model}")
        except NotStated:
            path = None
            found = ask(net, eps)
        entries.append(_entry(subject, model, found, net.component(eps), path))
        if progress is not None:
            progress(entries[-1])
        interrupted = found.interrupted
        if interrupted:
            break
    return tuple(entries), interrupted


def _entry(subject: str, model: str, found: Minimum, objective: str, path: Path | None) -> Entry:
    box = found.enclosure
    keep = [k for k, name in enumerate(box.names) if name != objective]
    names = tuple(box.names[k] for k in keep)
    enclosure = Box.empty(names) if box.is_empty else Box(names, box.lo[keep], box.hi[keep])
    certificate = None if path is None else path.name
    return Entry(
        subject=subject,
        model=model,
        eps_lo=found.lo,
        eps_hi=found.hi,
        enclosure=enclosure,
        certificate=certificate,
        seconds=found.seconds,
    )


def _check(cases: Mapping[str, Mapping[str, Model]], tolerance: float | None) -> None:
    wrong = [] if any(cases.values()) else [Problem("models", "there are none to compare", "give some networks")]
    for name in dict.fromkeys([*cases, *(m for models in cases.values() for m in models)]):
        if not re.fullmatch(r"\w[\w.-]*", name, re.ASCII):
            wrong.append(
                Problem("models", f"{name!r} cannot begin a file's name", "use letters of ASCII, digits, - and _")
            )
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance >= 0.0):
        wrong.append(Problem("tolerance", f"{tolerance} is no tolerance", "give a number, 0 or more"))
    if wrong:
        raise InputError(wrong)
