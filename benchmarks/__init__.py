"""Measurements of speed, run by hand: `python -m benchmarks list` says what there is. Figures, never tests."""
