from .accuracy import NamedPoses, certify_accuracy
from .findings import Accuracy, load_accuracy, save_accuracy

__all__ = [
    "Accuracy",
    "NamedPoses",
    "certify_accuracy",
    "load_accuracy",
    "save_accuracy",
]
