"""The one door to OpenCV, an optional extra."""

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import CpcalError, unusable

Grey8 = npt.NDArray[np.uint8]
Grey = Grey8 | npt.NDArray[np.uint16]  # an image (height, width), or with colours (height, width, 3), blue first


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


def marker_dictionary(name: str) -> Any:
    """OpenCV's dictionary of markers, such as 4X4_50. Raises InputError."""
    aruco, full = opencv().aruco, "DICT_" + name.removeprefix("DICT_")
    if not hasattr(aruco, full):
        raise unusable("target", f"has the dictionary {name!r:.40}", "give one such as 4X4_50 or APRILTAG_36h11")
    return aruco.getPredefinedDictionary(getattr(aruco, full))
