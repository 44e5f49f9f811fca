"""Real data, a user-defined constraint set: the anchors of a Hangprinter, as the example has them."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from cpcal import Verdict
from cpcal.checker import check

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT.parents[0] / "shared" / "data" / "hangprinter" / "samples.csv"
EPS = {"linear": (2.318231, 2.211257, 2.752856, 3.192902), "quadratic": (1.649541, 1.481699, 2.265669, 2.345835)}


@pytest.mark.real_data
@pytest.mark.skipif(not SAMPLES.exists(), reason=f"the Hangprinter's measurements are not at {SAMPLES}")
def test_smallest_model_error_of_every_cable(tmp_path: Path) -> None:
    example = runpy.run_path(str(ROOT / "docs" / "examples" / "hangprinter.py"))
    expected = {(c, model): eps for model, values in EPS.items() for c, eps in zip("abcd", values, strict=True)}
    for cable, model, found in example["smallest_errors"](*example["load"](SAMPLES), tmp_path):
        eps = expected.pop((cable, model))
        assert found.verdict is Verdict.PROVED
        assert (found.lo, found.hi) == pytest.approx((eps, eps), rel=1e-6)
        assert found.hi - found.lo <= 1e-6 * found.hi
        assert (np.abs(found.witness.point[:3]) <= 4000).all()
        claims = check(tmp_path / f"{cable}-{model}.cert.jsonl").claims
        assert (float(claims.eps_lo), float(claims.eps_hi)) == (found.lo, found.hi)
    assert not expected
