"""The page of `cpcal image detect`."""

from tinyhtml5.parser import HTMLParser

from cpcal.cli.image import MOST_ROWS, write_detections_page
from cpcal.vision.batch.detect import NUMBERS, Detection, Detections
from cpcal.vision.batch.study_images import SeenImage
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.target import DELTALAB_TARGET

EVIL = "<script>alert(1)</script>.png"
SIGMA = 0.004


def row(name, scale=1.0, doubt=""):
    values = {**dict.fromkeys(NUMBERS, 0.0), "qw": 1.0, "rms": SIGMA, "scale": scale, "sz": 0.0031, "shared_sz": 0.0012}
    return Detection(name, "", 130, tuple(values[number] for number in NUMBERS), doubt)


def page_of(tmp_path, rows, *, seconds=0.0, pictures=(), generator="somebody"):
    found = Detections(tuple(rows), len(rows) if seconds else 0, seconds)
    camera = CameraRecord(DELTALAB_CAMERA, provenance={"generator": generator})
    file = write_detections_page(found, pictures, DELTALAB_TARGET, camera, tmp_path / "poses.csv")
    assert file == tmp_path / "poses.csv.html"
    text = file.read_text(encoding="utf-8")
    parser = HTMLParser()
    parser.parse(text)
    assert parser.errors == []
    return text


def test_counts_reasons_and_time_are_told_and_names_are_no_markup(tmp_path):
    rows = [row("a.png"), row("b.png"), row("c.png", 7.5, "the residuals are 2.7 times as large")]
    rows += [Detection(EVIL, "is empty"), Detection("e.png", "is empty"), Detection("f.png", "not <identified>")]
    seen = SeenImage(rows[3], b"\xff\xd8 a picture", (420, 315))
    text = page_of(tmp_path, rows, seconds=0.8, pictures=(seen,))
    for part in (">2</span> found,", ">1</span> found, doubtful,", ">3</span> refused."):
        assert part in text
    assert text.index("<td>2</td>") < text.index("not &lt;identified&gt;")  # the most frequent reason first
    assert "<script" not in text
    assert text.count("data:image/jpeg;base64,") == 1
    assert "<td>7.5</td>" in text
    assert "0.0031" in text
    assert "0.0012" in text
    assert "6 images were measured now, in 133.3 ms of processor time each" in text
    assert "default-src 'none'; style-src 'unsafe-inline'; img-src data:" in text
    assert "http://" not in text
    assert "https://" not in text


def test_it_stays_short_and_says_what_it_leaves_out(tmp_path):
    rows = [Detection(f"{k}.png", f"{k} dots are too few") for k in range(MOST_ROWS + 5)]
    text = page_of(tmp_path, rows)
    assert "And 5 more, in poses.csv." in text
    assert "No image was measured now" in text
    rows = [row(f"{k}.png", 3.0 + k, "doubtful") for k in range(MOST_ROWS + 7)]
    text = page_of(tmp_path, rows)
    assert "And 7 more, in poses.csv." in text
    assert '<th scope="row">0.png</th>' not in text  # the least doubtful
