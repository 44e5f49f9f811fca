"""Several cameras that stand still to each other: where they are, and poses of the plate from all of them together."""
