"""Images from files: every kind that is understood comes back as it was; what is none has a reason."""

import os

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from cpcal.common.errors import InputError
from cpcal.vision.files.image_file import UnreadableImageError, image_files, image_path, read_image
from cpcal.vision.opencv import opencv

GREY = np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)


def written(path, image):
    assert opencv().imwrite(str(path), image)
    return path


@pytest.mark.parametrize("suffix", ["png", "tif", "tiff"])
@pytest.mark.parametrize(
    "image", [GREY, GREY.astype(np.uint16) * 257, np.dstack([GREY, GREY[::-1], GREY.T.reshape(48, 64)])]
)
def test_what_is_written_without_loss_is_read_back(tmp_path, suffix, image):
    assert np.array_equal(read_image(written(tmp_path / f"image.{suffix}", image)), image)


def test_what_is_no_image_has_a_reason(tmp_path):
    good = written(tmp_path / "good.png", GREY).read_bytes()
    photo = written(tmp_path / "good.jpg", GREY).read_bytes()
    bad = {
        "empty.png": (b"", "is empty"), "text.png": (b"this is a text file", "cannot|no image"),
        "cut.png": (good[: len(good) // 2], "truncated"), "cut.jpg": (photo[: len(photo) // 2], "truncated"),
        "head.png": (good[:20], "read"), "float.tiff": (None, "float32"),
    }  # fmt: skip
    written(tmp_path / "float.tiff", GREY.astype(np.float32))
    for name, (content, reason) in bad.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(UnreadableImageError, match=reason) as caught:
            read_image(tmp_path / name)
        assert "0x" not in str(caught.value)
    with pytest.raises(InputError, match="does not exist"):
        read_image(tmp_path / "absent.png")


def test_a_name_that_is_no_utf8_can_be_written_and_leads_to_its_file(tmp_path):
    for name in (b"\xff\xe9.png", b"a\\xe9.png", "é.png".encode()):
        (tmp_path / os.fsdecode(name)).write_bytes(name)
    names = image_files(tmp_path)
    assert names == [r"\xff\xe9.png", r"a\xe9.png", "é.png"]
    assert [image_path(tmp_path, name).read_bytes() for name in names] == [
        b"\xff\xe9.png",
        b"a\\xe9.png",
        "é.png".encode(),
    ]
