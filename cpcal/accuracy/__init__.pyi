from .accuracy import NamedPoses, certify_accuracy
from .findings import Accuracy, load_accuracy, save_accuracy
from .workspace import Workspace

__all__ = [
    "Accuracy",
    "NamedPoses",
    "Workspace",
    "certify_accuracy",
    "load_accuracy",
    "save_accuracy",
]
