"""The one door to OpenCV, an optional extra."""

from __future__ import annotations

from types import ModuleType

from cpcal.common.errors import CpcalError


class MissingExtraError(CpcalError):
    """Something optional is asked for and not installed."""


def opencv() -> ModuleType:
    """The module cv2. Raises MissingExtraError that says how to install it."""
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(f"images need OpenCV: pip install 'cpcal[vision]' ({error})") from error
    module: ModuleType = cv2
    return module
