"""Networks that are no legs are compared, and proved, as legs are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.checker import check
from cpcal.report.comparison_page import write_comparison


def line_network(degree, uncertain=False):
    """The best polynomial through an exponential, in the sense of Chebyshev."""
    t = np.linspace(0.0, 1.0, 17)
    net = cpcal.Network()
    value = net.variable("c0", domain=(-9.0, 9.0))
    for k in range(1, degree + 1):
        value = value + net.variable(f"c{k}", domain=(-9.0, 9.0)) * net.constant(t) ** k
    data = net.reading(np.exp(t), 1e-3) if uncertain else np.exp(t)
    eps = net.variable("eps", domain=(0.0, 100.0))
    net.add((value - data).within((-eps, eps)))
    return net, eps


def test_networks_are_compared_and_proved_in_the_same_way(tmp_path):
    cases = {"exp": {"line": line_network(1), "parabola": line_network(2), "loose": line_network(2, uncertain=True)}}
    comparison = cpcal.compare_networks(cases, tolerance=0.05, certificates=tmp_path)
    line, parabola, loose = comparison.entries
    assert line.word(0.05) == "refuted"
    assert parabola.word(0.05) == "not refuted"
    assert loose.word(0.05) == "not refuted, unchecked"
    assert parabola.eps_hi < line.eps_lo
    assert "c2" in parabola.enclosure.names
    assert "eps" not in parabola.enclosure.names
    assert {path.name for path in tmp_path.iterdir()} == {"exp-line.cert.jsonl", "exp-parabola.cert.jsonl"}
    assert all(check(path).claims.eps_lo is not None for path in tmp_path.iterdir())
    page = write_comparison(comparison, tmp_path).read_text(encoding="utf-8")
    assert "line is refuted at 0.05 for 1 of 1: exp (exp-line.cert.jsonl)." in page
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.compare_networks({"../x": {"a/b": line_network(1)}}, tolerance=float("nan"))
    assert len(refused.value.problems) == 3
    with pytest.raises(cpcal.InputError, match="none to compare"):
        cpcal.compare_networks({})


ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT.parents[0] / "shared" / "data" / "hangprinter" / "samples.csv"


@pytest.mark.real_data
@pytest.mark.skipif(not SAMPLES.exists(), reason=f"the Hangprinter's measurements are not at {SAMPLES}")
def test_the_linear_cable_model_is_refuted_where_the_quadratic_is_not(tmp_path):
    import runpy

    example = runpy.run_path(str(ROOT / "docs" / "examples" / "hangprinter.py"))
    comparison = example["compared"](*example["load"](SAMPLES), tolerance=2.0, certificates=tmp_path)
    expected = {
        "linear": (2.318231, 2.211257, 2.752856, 3.192902),
        "quadratic": (1.649541, 1.481699, 2.265669, 2.345835),
    }
    for model, values in expected.items():
        for cable, eps in zip("abcd", values, strict=True):
            entry = comparison.entry(cable, model)
            assert entry.eps_lo <= eps * (1 + 1e-6)
            assert entry.eps_hi >= eps * (1 - 1e-6)
            assert entry.eps_hi - entry.eps_lo <= 2e-6 * eps
            assert float(check(tmp_path / entry.certificate).claims.eps_lo) == entry.eps_lo
    refuted = {(entry.subject, entry.model) for entry in comparison.refuted()}
    assert refuted == {*((c, "linear") for c in "abcd"), ("c", "quadratic"), ("d", "quadratic")}
