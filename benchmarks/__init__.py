"""Measurements of speed, run by hand: figures, never tests."""
