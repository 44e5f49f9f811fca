"""Images from files: PNG, JPEG and TIFF, 8 or 16 bits, grey or colour. What is none has a reason in words."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.errors import CpcalError
from cpcal.vision.opencv import opencv

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
PIXELS_MAX = 2**27  # of an image that is read at all
_ENDS = ((b"\x89PNG\r\n", b"IEND"), (b"\xff\xd8", b"\xff\xd9"))  # how PNG and JPEG begin and end
_TAIL = 4096  # bytes, among which the end is looked for: some cameras append to it


class UnreadableImageError(CpcalError):
    """A file is no image that can be used; the message is the reason."""


def image_files(folder: Path) -> list[str]:
    """The names, relative to `folder` and with "/", of all images in it and below, in order."""
    found = (path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    return sorted(path.relative_to(folder).as_posix() for path in found)


def read_image(path: Path) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """The image (height, width) or (height, width, 3), blue first. Raises UnreadableImageError, MissingExtraError."""
    cv2 = opencv()
    _check_header(path)
    try:
        content = np.fromfile(path, dtype=np.uint8)
        _check_end(content.tobytes())
        image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    except (OSError, cv2.error, MemoryError) as error:
        raise UnreadableImageError(f"cannot be read: {_first_line(error)}") from None
    if image is None:
        raise UnreadableImageError("cannot be decoded: truncated, or no image")
    if image.dtype not in (np.uint8, np.uint16):
        raise UnreadableImageError(f"has pixels of {image.dtype}; 8 or 16 bits are understood")
    return np.asarray(image[..., :3]) if image.ndim == 3 else np.asarray(image)


def _check_header(path: Path) -> None:
    """Before anything is decoded: a small file may claim to hold a huge image. A truncated one is refused."""
    from PIL import Image

    try:
        if not path.stat().st_size:
            raise UnreadableImageError("is empty")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of large images, and of odd metadata
            with Image.open(path) as header:
                width, height = header.size
    except OSError as error:
        raise UnreadableImageError(f"cannot be read: {_first_line(error)}") from None
    except (ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise UnreadableImageError(f"is no image that can be read: {_first_line(error)}") from None
    if width * height > PIXELS_MAX:
        raise UnreadableImageError(f"has {width} x {height} pixels, more than {PIXELS_MAX:,}")


def _check_end(content: bytes) -> None:
    """OpenCV fills up what is missing of a truncated file, and says nothing."""
    for begin, end in _ENDS:
        if content.startswith(begin) and end not in content[-_TAIL:]:
            raise UnreadableImageError("is truncated: the end of the file is missing")


def _first_line(error: BaseException) -> str:
    """Without the file's path, so that the same image has the same reason wherever it is."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error).partition(" '")[0]
    return (text or type(error).__name__).splitlines()[0][:200]
