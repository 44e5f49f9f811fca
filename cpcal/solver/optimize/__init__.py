"""Smallest values: bounded from both sides, or fitted."""
