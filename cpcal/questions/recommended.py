"""The parameters to load, and the tolerances that they meet for ALL readings (DESIGN section 6).

    E(x) = max over measurements k, max over all readings M in the k-th set, of |g(x, M)|      mm

Least squares, weighted by the stated deviations, where E is within the tolerance T; else the least sum of squares
among x with E(x) <= T. Both are found in floating point, about one point after the other; then E is proved at the
point that was found. Where no point meets T, or none is given, the point is least squares without weights.
"""

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from cpcal.common.values import Floats, Json, norms
from cpcal.models import (
    PLAIN,
    ModelResiduals,
    built_in,
    fit_model,
    leg_readings,
    leg_statement,
    reading_moves,
    reading_range,
)
from cpcal.questions.bracket import PreparedLeg, written
from cpcal.questions.result import CONSTRAINED, LEAST_SQUARES, PassesFrom, Recommended, Reduced
from cpcal.solver.certificate.float_rows import AllReadings
from cpcal.solver.certificate.prover import claims
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.interval import Box
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit_of_many

_ROUNDED = 1e-9  # of the largest number of a leg: a million times more than rounding errors of its lengths
_BELOW = 1e-9  # relative, below a tolerance: slack left so that the proof at the point succeeds
_FITS = 3  # each with the slack that the one before lacked
_STEPS, _AT_REST = 20, 1e-9  # of Gauss-Newton; the change of the residuals, relative to the tolerance, that ends it
_NEAR, _ROUNDS = 64, 8  # rows that enter a program at a time; times that they enter
_PARTS = 1024  # the factor on the half-widths is a multiple of one of so many


def conformity(part: PreparedLeg, lo: float) -> Json:
    """The fields of `LegResult` that are of all readings of a leg, or of some of its measurements.

    No parameters satisfy its equations below `lo` for any readings.
    """
    of, tolerance = _Leg(part), part.question.options.tolerance
    x, why, reduced = of.plain, LEAST_SQUARES, None
    eps = of.largest(of.tightest)
    if tolerance is not None and lo <= tolerance:
        weighted = of.fit(of.weight)
        if of.largest(weighted) <= tolerance:
            x = weighted
        elif eps <= tolerance:
            x, why = of.within(tolerance), CONSTRAINED
        else:
            factor = _most(lambda share: of.largest(x, share) <= tolerance)
            reduced = Reduced(factor, of.certificate("reduced", x, tolerance, factor) if factor else None)
    passes = None
    if math.isfinite(eps):
        passes = PassesFrom(eps, tuple(of.tightest.tolist()), of.certificate("passes", of.tightest, eps))
    largest = of.largest(x)
    recommended = Recommended(tuple(x.tolist()), why, largest, of.certificate("recommended", x, largest))
    return {"recommended": recommended, "passes_from": passes, "reduced": reduced}


class _Leg:
    """One leg, for every reading of its measurements."""

    def __init__(self, part: PreparedLeg) -> None:
        question, leg, only = part.question, part.leg, part.only
        campaign, model = question.campaign, question.model
        self._part, self._question, self._leg, self._network = part, question, leg, part.problem.network
        self._residuals = ModelResiduals(campaign, leg, model)
        self._mine = np.arange(len(campaign)) if only is None else np.array(only, np.intp)
        self._known: dict[bytes, AllReadings] = {}
        self._built_in = built_in(model)
        self._readings = [each[self._mine] for each in leg_readings(campaign, leg)]
        self._used = np.bincount(self._mine, minlength=len(campaign)).astype(np.float64)
        self._rows = Rows(self._network, every=True)
        fitted = only is None and question.options.center == "fit"
        self.plain = part.center if fitted else self.fit(None if only is None else self._used)

    @cached_property
    def weight(self) -> Floats:
        """Of residuals: one over the deviations that the half-widths state."""
        moves = norms(reading_moves(self._question.campaign, self._leg, self.plain))
        return self._used / moves if moves.min() > 0.0 else self._used

    def fit(self, weight: Floats | None) -> Floats:
        """Least squares."""
        question = self._question
        return fit_model(question.campaign, self._leg, question.model, weight)

    def largest(self, x: Floats, factor: float = 1.0) -> float:
        """PROVED: a bound of E(x), mm, with `factor` times the stated half-widths; infinite where nothing is proved.

        Of a model that comes with cpcal the least that the exact proof of a certificate reaches."""
        question, key = self._question, x.tobytes()
        if self._built_in:
            if key not in self._known:
                self._known[key] = AllReadings(question.model.name, x.tolist(), *self._decisive(x))
            return self._known[key].least_eps(factor)
        found = reading_range(question.campaign, self._leg, question.model, x, factor)
        return float(np.max(np.maximum(found.hi, -found.lo)[self._mine], initial=0.0))

    def _decisive(self, x: Floats) -> list[Floats]:
        """The readings of the measurements that can decide E(x).

        Of exact ones the shortest, and those furthest off: by many times of what rounding can move either, the others
        are not. In other models this is no cheaper than the proof.
        """
        given, radii = self._readings
        if self._question.model.name != PLAIN.name or radii.any():
            return self._readings
        off, read = np.abs(self._residuals.values(x))[self._mine], given[:, 7]
        slack = _ROUNDED * (np.abs(given).max() + np.abs(x).max())
        decide = (off >= off.max() - slack) | (read <= read.min() + slack)
        return [given[decide], radii[decide]]

    def certificate(self, name: str, x: Floats, eps: float, factor: float = 1.0) -> str | None:
        """The file that claims E(x) <= eps with that factor on the half-widths; None where there is none."""
        if not self._built_in or self._question.certificates is None or not math.isfinite(eps):
            return None
        part, question, at = self._part, self._question, np.append(x, eps)
        stated = part.statement or leg_statement(question.campaign, part.leg, part.only, question.model.name)
        with Recording(stated, Box((*question.model.parameters, "eps"), at, at)) as recording:
            said = claims(eps, point=at, factor=factor)
            return written(question, f"leg{part.leg}.{name}", recording, said)[0]

    @cached_property
    def tightest(self) -> Floats:
        """A local minimiser of E in the leg's box, for which `lo` is proved: so its E is not below `lo`."""
        box = self._network.domain.replace("eps", lo=0.0, hi=np.inf)
        inside = np.clip(self.plain, box.lo[:-1], box.hi[:-1])
        start = np.append(inside, self._network.domain["eps"].lo)  # where the search has begun, too
        found = fit_of_many(self._network, self._rows, len(inside), start, box).point[:-1]
        return np.clip(found, box.lo[:-1], box.hi[:-1])

    def within(self, tolerance: float) -> Floats:
        """The least weighted sum of squares among x with E(x) <= tolerance, by a local search from `tightest`, which
        has it; where that search does not end in such an x, one on the way to it."""
        x, slack = self.tightest, _BELOW * tolerance
        for _ in range(_FITS):
            x = self._constrained(tolerance - slack)
            beyond = self.largest(x) - tolerance
            if beyond <= 0.0:
                return x
            slack += 1.01 * beyond
        way = x - self.tightest
        return self.tightest + _most(lambda share: self.largest(self.tightest + share * way) <= tolerance) * way

    def _constrained(self, tolerance: float) -> Floats:
        """Gauss-Newton whose steps keep every row, linearised at its worst readings, within the tolerance."""
        x, box = self.tightest, self._network.domain
        for _ in range(_STEPS):
            slopes = self.weight[:, None] * self._residuals.jacobian(x)
            rows = self._rows.linearize(np.append(x, tolerance))
            step = nearest_within(slopes, self.weight * self._residuals.values(x), rows.jacobian[:, :-1], -rows.values)
            if step is None:
                break
            x = np.clip(x + step, box.lo[:-1], box.hi[:-1])
            if float(np.max(np.abs(slopes @ step))) <= _AT_REST * tolerance * float(self.weight.max()):
                break
        return x


def _most(passes: Callable[[float], bool]) -> float:
    """The largest multiple of 1/1024, 1 at most, that passes, if smaller ones do; 0 is not tried."""
    low, high = 0, _PARTS
    if passes(1.0):
        return 1.0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if passes(middle / _PARTS) else (low, middle)
    return low / _PARTS


def nearest_within(slopes: Floats, values: Floats, rows: Floats, limits: Floats) -> Floats | None:
    """The step d (n,) with the least |values + slopes d| of those with `rows @ d <= limits`; None: none is found.

    With the QR decomposition of the slopes it is the point of a polyhedron nearest to the origin, which non-negative
    least squares finds (Lawson and Hanson, Solving Least Squares Problems, chapter 23: LDP).
    """
    from scipy.optimize import nnls  # here: it takes half a second to load

    size = np.maximum(np.abs(slopes).max(axis=0), 1e-300)
    ridge = 1e-10 * len(slopes) * np.eye(len(size))  # what the measurements leave open stays
    left, right = np.linalg.qr(np.concatenate([slopes / size, ridge]))
    start = left[: len(values)].T @ values
    turned = -np.linalg.solve(right.T, (rows / size).T).T  # G of G y >= h
    length = np.maximum(norms(turned), 1e-300)
    turned, least = turned / length[:, None], (turned @ start - limits) / length
    y, some = np.zeros(len(size)), np.zeros(0, np.intp)
    for _ in range(_ROUNDS):
        lacks = least - turned @ y
        more = np.union1d(some, np.argsort(-lacks)[:_NEAR][np.sort(-lacks)[:_NEAR] < 1e-9 * np.abs(start).max()])
        if len(more) == len(some):
            break
        some = more
        system = np.concatenate([turned[some].T, least[None, some]])
        aim = np.append(np.zeros(len(size)), 1.0)
        rest = system @ nnls(system, aim)[0] - aim
        if not rest[-1] < -1e-12:
            return None
        y = -rest[:-1] / rest[-1]
    return np.asarray(np.linalg.solve(right, y - start) / size)
