"""A wrong image among right ones is found and proved; what is false is refused."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.handeye import wrong_images
from cpcal.handeye.certify_hand_eye import Within
from cpcal.handeye.hand_eye_files import hand_eye_files
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.handeye.simulate_hand_eye import simulate_hand_eye
from cpcal.handeye.verify_wrong_images import verify_wrong_images
from cpcal.handeye.wrong_images import find_wrong_images, save_wrong_images
from cpcal.robot import Pose


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wrong")
    study = simulate_hand_eye(images=14, corners=(4, 3), pitch=60.0, seed=11).study
    moved = np.array(study.poses.position)
    moved[4] += [8.0, -5.0, 4.0]
    fields = {name: getattr(study, name) for name in study.__dataclass_fields__}
    study = HandEyeStudy(**fields | {"poses": Pose(moved, study.poses.quaternion)})
    for name, content in hand_eye_files(study).items():
        (folder / name).write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wrong_images, "_TRIALS", 8)  # one image of fourteen is wrong: most of them begin without it
        found = find_wrong_images(study, 1, folder, within=Within(20.0, 0.8))
    save_wrong_images(found, folder)
    return folder, found


def test_the_wrong_image_is_named_and_proved(finished):
    folder, found = finished
    assert found.left_out == ("image005",)
    assert [image for image, _ in found.blamed] == ["image005"]
    assert 0.0 < found.eps_lo <= found.eps_hi <= 0.2
    assert [accepted for accepted, _ in verify_wrong_images(folder)] == [True] * 4


FORGERIES = {
    "a larger lower end": lambda d: d.update(eps_lo=d["eps_lo"] * 1.001),
    "more wrong images": lambda d: d.update(outliers=2),
    "a smaller upper end": lambda d: d.update(eps_hi=d["eps_hi"] * (1 - 1e-9)),
    "nothing left out": lambda d: d.update(left_out=[]),
    "one group twice": lambda d: d["groups"].__setitem__(1, d["groups"][0]),
    "another image blamed": lambda d: d["blamed"][0].__setitem__(0, "image001"),
    "one reason too few": lambda d: d["blamed"][0][1].pop(),
    "another tolerance": lambda d: d.update(tolerance=d["tolerance"] * 1.5),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_an_edited_answer_is_refused(finished, refused, name):
    assert refused(finished[0], "handeye-wrong.json", FORGERIES[name], verify_wrong_images)


def test_too_many_wrong_images_for_the_study_are_refused(tmp_path):
    study = simulate_hand_eye(images=9, corners=(3, 3), seed=1).study
    with pytest.raises(InputError, match="outliers"):
        find_wrong_images(study, 2, tmp_path)
