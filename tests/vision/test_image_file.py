"""Files of images come back as they were; files that are none, or made to hurt, are refused soon, with a sentence."""

import json
import os
import struct
import zlib
from itertools import product

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.vision.batch.detect import NUMBERS, ImageFolder, detect
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.image_file import UnreadableImageError, image_files, image_path, read_image
from cpcal.vision.opencv import opencv
from cpcal.vision.target import DELTALAB_TARGET

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

GREY = np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)


def written(path, image):
    assert opencv().imwrite(str(path), image)
    return path


COLOUR = np.dstack([GREY, GREY[::-1], GREY.T.reshape(48, 64)])


@pytest.mark.parametrize(
    ("suffix", "image"),
    [*product(["png", "tif", "tiff", "bmp"], [GREY, COLOUR]), *product(["png", "tif"], [GREY.astype(np.uint16) * 257])],
)
def test_what_is_written_without_loss_is_read_back(tmp_path, suffix, image):
    assert np.array_equal(read_image(written(tmp_path / f"image.{suffix}", image)), image)


def test_what_is_no_image_has_a_reason(tmp_path):
    good = written(tmp_path / "good.png", GREY).read_bytes()
    photo = written(tmp_path / "good.jpg", GREY).read_bytes()
    bad = {
        "empty.png": (b"", "is empty"), "text.png": (b"this is a text file", "cannot|no image"),
        "cut.png": (good[: len(good) // 2], "truncated"), "cut.jpg": (photo[: len(photo) // 2], "truncated"),
        "cut.bmp": (written(tmp_path / "good.bmp", GREY).read_bytes()[:-100], "truncated"),
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
    given = [b"\xff\xe9.png", b"a\\xe9.png", "é.png".encode()]
    for name in given:
        (tmp_path / os.fsdecode(name)).write_bytes(name)
    names = image_files(tmp_path)
    assert names == [r"\xff\xe9.png", r"a\xe9.png", "é.png"]
    assert [image_path(tmp_path, name).read_bytes() for name in names] == given


DEEP = 200_000  # brackets


def png(width, height, bits):
    """A PNG of few bytes that is complete, and claims a size."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("content", "size", "reason"),
    [
        (png(11585, 11585, 16), None, "has 11585 x 11585 pixels, more than 100,000,000"),
        (png(4000, 3000, 8), (1024, 768), "the image is 4000 x 3000 pixels, the camera's images are 1024 x 768"),
        (b"BM" + bytes(1000), None, "cannot be read"),
    ],
)
def test_an_image_is_refused_by_its_header_and_never_decoded(tmp_path, monkeypatch, content, size, reason):
    def decoded(*_):
        raise AssertionError("the image was decoded")

    monkeypatch.setattr(np, "frombuffer", decoded)
    (tmp_path / "image.png").write_bytes(content)
    with pytest.raises(UnreadableImageError, match=reason):
        read_image(tmp_path / "image.png", size)


def test_a_file_of_terabytes_is_refused_unread(tmp_path):
    with (tmp_path / "image.png").open("wb") as file:
        file.truncate(2**40)  # takes no room on the disk
    with pytest.raises(InputError, match="is larger than 400,000,000 bytes"):
        read_image(tmp_path / "image.png")


@pytest.fixture(params=["pipe", "device"])
def no_file(request, tmp_path):
    """A folder, and what to put there under a name: a pipe that nobody writes to, or a device without an end."""

    def make(name):
        if request.param == "pipe":
            os.mkfifo(tmp_path / name)
        else:
            (tmp_path / name).symlink_to("/dev/zero")
        return tmp_path / name

    return make


def test_pipes_and_devices_are_no_images(no_file):
    path = no_file("image.png")
    with pytest.raises(InputError, match="is no regular file"):
        read_image(path)
    found = detect(ImageFolder(path.parent), DELTALAB_TARGET, DELTALAB_CAMERA, workers=1)
    assert [(row.file, row.reason) for row in found.rows] == [("image.png", "cannot be read: it is no regular file")]


def test_lines_that_no_journal_holds_are_dropped(tmp_path):
    (tmp_path / "a.png").write_bytes(b"")
    one_image, journal = ImageFolder(tmp_path), tmp_path / "journal"
    known = detect(one_image, DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal)
    head, line = journal.read_text().splitlines()
    row = json.loads(line)
    wrong = [{"reason": "", "values": [1.0]}, {"reason": 5}, {"stamp": None}, {"file": ["a.png"]}]
    wrong += [{"reason": "", "values": [value] * len(NUMBERS)} for value in (float("nan"), 10**400)]
    for text in ("[" * DEEP, "7", "null", '{"file": "a.png"}', *(json.dumps({**row, **one}) for one in wrong)):
        journal.write_text(f"{head}\n{text}\n")
        again = detect(one_image, DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal)
        assert again.measured == 1, text
        assert again.rows == known.rows
    journal.write_text(f"{head}\n{line}\n")
    assert detect(one_image, DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal).measured == 0


def test_pipes_and_devices_are_no_journals(no_file, tmp_path):
    (tmp_path / "images").mkdir()
    with pytest.raises(InputError, match="it is no regular file"):
        detect(ImageFolder(tmp_path / "images"), DELTALAB_TARGET, DELTALAB_CAMERA, journal=no_file("journal"))


def test_a_link_to_nothing_is_an_image_with_a_reason(tmp_path):
    (tmp_path / "image.png").symlink_to(tmp_path / "nothing.png")
    journal = tmp_path / "journal"
    for measured in (1, 0):
        found = detect(ImageFolder(tmp_path), DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal)
        assert [row.reason for row in found.rows] == ["does not exist"]
        assert found.measured == measured


def test_colours_and_depth_count_for_the_memory_of_an_image(tmp_path):
    head = struct.pack(">IIBBBBB", 9000, 9000, 16, 6, 0, 0, 0)  # 81 million pixels of 8 bytes
    content = png(1, 1, 8).replace(struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0), head)
    at = content.index(head) + len(head)
    content = content[:at] + struct.pack(">I", zlib.crc32(b"IHDR" + head)) + content[at + 4 :]
    (tmp_path / "image.png").write_bytes(content)
    with pytest.raises(UnreadableImageError, match="would take 648,000,000 bytes when decoded"):
        read_image(tmp_path / "image.png")
