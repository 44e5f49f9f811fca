from .checkpoint_file import (
    FOLDER,
    Checkpoint,
    Checkpoints,
    Line,
)
from .executors import (
    Here,
    LostWorkerError,
    Place,
    Processes,
    Shared,
    executor_for,
    linear_algebra_on_one_thread,
    outcomes,
    while_used,
)
from .stopping import (
    Reason,
    Stopped,
    asked,
    give_up,
    heard,
    raising,
)

__all__ = [
    "FOLDER",
    "Checkpoint",
    "Checkpoints",
    "Here",
    "Line",
    "LostWorkerError",
    "Place",
    "Processes",
    "Reason",
    "Shared",
    "Stopped",
    "asked",
    "executor_for",
    "give_up",
    "heard",
    "linear_algebra_on_one_thread",
    "outcomes",
    "raising",
    "while_used",
]
