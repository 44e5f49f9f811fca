"""Images from files: PNG, JPEG, TIFF and BMP, 8 or 16 bits, grey or colour. What is none has a reason in words."""

import io
import os
import re
import warnings
from pathlib import Path

import numpy as np

from cpcal.common.errors import CpcalError
from cpcal.common.files import small_file
from cpcal.vision.opencv import Grey, opencv

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
PIXELS_MAX = 100_000_000  # of an image that is read at all
BYTES_MAX = 400_000_000  # of a file, and of its pixels when it is decoded
_ENDS = ((b"\x89PNG\r\n", b"IEND"), (b"\xff\xd8", b"\xff\xd9"))  # how PNG and JPEG begin and end
_TAIL = 4096  # bytes, among which the end is looked for: some cameras append to it


class UnreadableImageError(CpcalError):
    """A file is no image that can be used; the message is the reason."""


def image_files(folder: Path) -> list[str]:
    """The names, relative to `folder` and with "/", of all images in it and below, in order.

    Bytes of a name that are no UTF-8 stand as \\xe9, so that every name can be written: `image_path` finds the file.
    """
    found = (path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and not path.is_dir())
    names = (os.fsencode(path.relative_to(folder).as_posix()) for path in found)
    return sorted(name.decode("utf-8", "backslashreplace") for name in names)


def image_path(folder: Path, name: str) -> Path:
    """The file that `image_files` named so."""
    if "\\x" not in name or os.path.lexists(folder / name):
        return folder / name
    return folder / os.fsdecode(re.sub(rb"\\x([89a-f][0-9a-f])", lambda x: bytes.fromhex(x[1].decode()), name.encode()))


def read_image(path: Path, size: tuple[int, int] | None = None) -> Grey:
    """The image (height, width) or (height, width, 3), blue first; `size` (width, height), where given, is the only one
    that is accepted. What is too large, or of another size, is refused before it is decoded.

    Raises InputError for a file that cannot be read, UnreadableImageError for what is no image, MissingExtraError.
    """
    cv2 = opencv()
    content = small_file(path, "give an image", most=BYTES_MAX)
    if not content:
        raise UnreadableImageError("is empty")
    _check_header(content, size)
    cut = content[:2] == b"BM" and len(content) < int.from_bytes(content[2:6], "little")  # a BMP says how long it is
    if cut or any(content.startswith(begin) and end not in content[-_TAIL:] for begin, end in _ENDS):
        # OpenCV fills up what is missing, and says nothing
        raise UnreadableImageError("is truncated: the end of the file is missing")
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError) as error:
        raise UnreadableImageError(f"cannot be read: {_first_line(error)}") from None
    if image is None:
        raise UnreadableImageError("cannot be decoded: truncated, or no image")
    if image.dtype not in (np.uint8, np.uint16):
        raise UnreadableImageError(f"has pixels of {image.dtype}; 8 or 16 bits are understood")
    return image[..., :3] if image.ndim == 3 else np.asarray(image)


def _check_header(content: bytes, size: tuple[int, int] | None) -> None:
    """Before anything is decoded: a small file may claim to hold a huge image. A truncated one is refused."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of large images, and of odd metadata
            with Image.open(io.BytesIO(content), formats=("PNG", "JPEG", "TIFF", "BMP")) as header:
                (width, height), bands = header.size, len(header.getbands())
                # of a pixel, at most: Pillow does not tell 16 bits of a colour from 8
                deep = 4 if header.mode in ("I", "F") else 1 if header.format == "JPEG" else 2
    except OSError as error:
        raise UnreadableImageError(f"cannot be read: {_first_line(error)}") from None
    except Image.DecompressionBombError:
        raise UnreadableImageError(f"has more than {PIXELS_MAX:,} pixels") from None
    except Exception as error:  # Pillow raises all kinds for headers that are none
        raise UnreadableImageError(f"is no image that can be read: {_first_line(error)}") from None
    if size is not None and (width, height) != size:
        raise UnreadableImageError(
            "the image is {} x {} pixels, the camera's images are {} x {}".format(width, height, *size)
        )
    if width * height > PIXELS_MAX:
        raise UnreadableImageError(f"has {width} x {height} pixels, more than {PIXELS_MAX:,}")
    if (decoded := width * height * bands * deep) > BYTES_MAX:
        raise UnreadableImageError(f"would take {decoded:,} bytes when decoded, more than {BYTES_MAX:,}")


def _first_line(error: BaseException) -> str:
    """Without the place in memory that Pillow names, so that the same image has the same reason always."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error).partition(" <")[0]
    return (text or type(error).__name__).splitlines()[0][:200]
