"""Thousands of images: in parallel, resumable, the same table whatever the workers; images of simulated studies."""
