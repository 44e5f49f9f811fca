"""`python -m benchmarks.damaged_runs`: files damaged at random are refused with a sentence, or mean what they say.

    python -m benchmarks.damaged_runs [SUBJECT ...] [--count 10000] [--seed 1] [--log FILE]

Subjects are inputs of cpcal, and genuine runs of every kind (RUNS), which share the count. A mutation is
one of MUTATIONS, of one file that is drawn at random; seeded, so that number k of a seed is always the same. Each is
read in a process of its own. The outcome is

    refused    InputError, Refused or an exit status of 1 or 2 with a message
    same       what was read is what the good files say, but for what a file calls information
    other      an input that states something else, and says so: it is read back the same when it is saved, and (a
               campaign) has another SHA-256, so that no certificate of the good one is taken for it
    CHANGED    a run that is accepted with other claims: must not happen
    TRACEBACK  any other exception: must not happen
    COSTLY     more than 10 s of processor time, or more than 500 MB: must not happen

Exit status 1 when one of the last three happened. The log has a line for each acceptance: number, file, mutation,
outcome and why it is harmless.
"""

import json
import os
import pickle
import random
import re
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from typer.testing import CliRunner

from benchmarks import asked, run_by_hand
from benchmarks.pose_sets import shown
from benchmarks.vision_scenes import facing_poses
from cpcal.cli import app
from cpcal.cli.verbs import Status
from cpcal.common.codec import INFORMATION
from cpcal.common.errors import InputError
from cpcal.common.values import same
from cpcal.files import campaign_sha256, load_campaign, load_study, save_campaign, save_campaign_json, save_study
from cpcal.models.hand_eye import save_hand_eye, simulate_hand_eye
from cpcal.models.sight import CameraSet, PixelBoxes, TargetSet, enclose_pose
from cpcal.questions import calibrate_study, certify
from cpcal.questions.accuracy import NamedPoses, certify_accuracy, save_accuracy
from cpcal.questions.points import certify_fits
from cpcal.questions.study_calibration import load_record, save_record
from cpcal.robot import Campaign, Pose
from cpcal.simulate import simulate, simulate_study
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import load_camera, load_target, save_camera, save_target
from cpcal.vision.target import DELTALAB_TARGET, Target

BAD = ("CHANGED", "TRACEBACK", "COSTLY")
SECONDS, MEGABYTES = 10.0, 500.0  # of a verification


class Refusal(Exception):
    """A command that left with status 1 or 2, and its message."""


@dataclass(frozen=True)
class Subject:
    """`write` makes good files in an empty folder; `read` says what files claim, or refuses; of what is claimed
    otherwise, `harmless` says why that is harmless, or None."""

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    harmless: Callable[[Any, Any], str | None]
    mutated: str = "**/*"  # which of the files


@dataclass(frozen=True)
class Outcome:
    """What became of one mutation."""

    number: int
    file: str
    mutation: str
    kind: str
    why: str
    seconds: float
    megabytes: float


# how it is damaged: by a slip of the hand, a broken disk, a careless script or somebody hostile ----------------------

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]{2,}")
_HOSTILE_NUMBERS = [
    *(b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e999", b"-1e999", b"1e308", b"1e155", b"-1e200", b"5e-324"),
    *(b"0", b"-0.0", b"1", b"-1", b"2", b"9" * 400, b"9" * 5000, b"0x1p10", b"1_000", b"true", b"null", b'"1"', b""),
]
_HOSTILE_TEXTS = [
    *(b"\x00", b"\xff", b"\xef\xbb\xbf", b"\n", b"\r", b"\xe2\x80\xae", b"\\u202e", b"\\ud800", b"\x1b[2J", b"=cmd"),
    *(bytes([c]) for c in b"[]{}\"',.=#/"),
    *(b"..", b"[" * 5000, b'{"a":' * 2000, b"x" * 70000),
]

Mutation = Callable[[random.Random, bytes], bytes]


def _flip(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _cut(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.choice([1, 2, 10, 100]) :]


def _end(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data))]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(_HOSTILE_TEXTS) + data[at:]


def _number(rng: random.Random, data: bytes) -> bytes:
    """Another number, or something that is none, in place of a number."""
    return _replaced(rng, data, _NUMBER, lambda _: rng.choice(_HOSTILE_NUMBERS))


def _digit(rng: random.Random, data: bytes) -> bytes:
    """The number with one digit changed: what no reader can notice by itself."""

    def changed(old: bytes) -> bytes:
        at = rng.choice([k for k, c in enumerate(old) if chr(c).isdigit()])
        return old[:at] + str(rng.randrange(10)).encode() + old[at + 1 :]

    return _replaced(rng, data, _NUMBER, changed)


def _sign(rng: random.Random, data: bytes) -> bytes:
    return _replaced(rng, data, _NUMBER, lambda old: old[1:] if old.startswith(b"-") else b"-" + old)


def _other_number(rng: random.Random, data: bytes) -> bytes:
    """A number of the file in place of another one of it."""
    numbers = _NUMBER.findall(data) or [b"1"]
    return _replaced(rng, data, _NUMBER, lambda _: rng.choice(numbers))


def _word(rng: random.Random, data: bytes) -> bytes:
    """A word of the file, a misspelt one or a hostile text in place of a word."""
    words = _WORD.findall(data) or [b"x"]
    kinds: list[Callable[[bytes], bytes]] = [
        lambda old: rng.choice(words),
        lambda old: old[:-1],
        lambda old: old + old[-1:],
        lambda old: rng.choice(_HOSTILE_TEXTS),
    ]
    return _replaced(rng, data, _WORD, rng.choice(kinds))


def _lines(rng: random.Random, data: bytes) -> bytes:
    """A line taken out, doubled, or exchanged with another one."""
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _replaced(rng: random.Random, data: bytes, what: re.Pattern[bytes], by: Callable[[bytes], bytes]) -> bytes:
    if not (places := [m.span() for m in what.finditer(data)]):
        return _flip(rng, data)
    start, end = rng.choice(places)
    return data[:start] + by(data[start:end]) + data[end:]


MUTATIONS: dict[str, Mutation] = {
    "bit flipped": _flip, "piece cut out": _cut, "end cut off": _end, "text inserted": _insert,
    "number replaced": _number, "digit changed": _digit, "sign changed": _sign, "other number": _other_number,
    "word replaced": _word, "lines changed": _lines,
}  # fmt: skip


def mutated(rng: random.Random, data: bytes) -> tuple[str, bytes]:
    """The name of a mutation, or of two, and the bytes after it; never the bytes as they were."""
    while True:
        names = rng.choices(list(MUTATIONS), k=rng.choice([1, 1, 1, 2]))
        out = data
        for name in names:
            out = MUTATIONS[name](rng, out) if out else out
        if out != data:
            return " + ".join(names), out


# small genuine runs of every kind that `cpcal verify` reads, as the commands write them, each in an empty folder -----

PROBLEM = "variables x in [-1, 1]; y in [0, 2]; minimize x^2 + y; constraints x + y >= 0.5; end"
NARROW = ("--legs", "1", "--delta", "0.5", "--gap", "1e-2")


def command(*words: object) -> None:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code in (0, 1), done.output


def _campaign(folder: Path, **changes: object) -> Path:
    options = {"seed": 1, "extremal": False, "random_poses": 9, "joint_error": 1.0, "factor": 0.0} | changes
    save_campaign(simulate(**options), folder / "campaign")  # type: ignore[arg-type]
    return folder / "campaign"


def leg(folder: Path) -> None:
    command("certify", _campaign(folder), *NARROW, "-o", folder / "run")


def uncertain_leg(folder: Path) -> None:
    campaign = _campaign(folder, factor=3.0, joint_error=0.0, random_poses=8)
    command("certify", campaign, *NARROW, "--eps", "0.05", "-o", folder / "run")


def undecided_leg(folder: Path) -> None:
    """Which would pass with smaller half-widths."""
    campaign = _campaign(folder, factor=1.0)
    command("certify", campaign, *NARROW, "--tolerance", "0.1797", "-o", folder / "run")


def robust(folder: Path) -> None:
    command("certify", _campaign(folder), "--legs", "1", "--delta", "0.5", "--outliers", "1", "-o", folder / "run")


def compare(folder: Path) -> None:
    command("certify", _campaign(folder), *NARROW, "--model", "plain,lateral", "-o", folder / "run")


def fits(folder: Path) -> None:
    study = simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0)
    found = calibrate_study(study)
    certify_fits(found.campaign, found.record, folder / "run", legs=[2, 5])


def accuracy(folder: Path) -> None:
    campaign = simulate(seed=3, extremal=False, random_poses=12, noise=0.0, factor=0.0, joint_error=0.02)
    result = certify(campaign, delta=8.0, support="none", center="nominal")
    poses = NamedPoses(("home",), Pose(np.array([[0.0, 0.0, 360.0]]), np.array([[1.0, 0.0, 0.0, 0.0]])))
    run = save_campaign_json(campaign, folder / "run").parent
    save_accuracy(certify_accuracy(campaign, result, poses=poses, assume=0.02, certificates=run), run)


def pose_sets(folder: Path) -> None:
    """Of seven dots, whose places are uncertain."""
    rng = np.random.default_rng(7)
    few = Target("few dots", DELTALAB_TARGET.dots[::12], 6.0)
    targets, cameras = TargetSet(few, 0.01), CameraSet(DELTALAB_CAMERA)
    numbers, centers = shown(rng, facing_poses(rng, 1).rows(0), cameras, targets)
    boxes = PixelBoxes.around(numbers, centers, 0.05, of_images=True)
    (folder / "run").mkdir()
    enclose_pose(boxes, targets, cameras, certificate=folder / "run" / "one", sources={"camera.toml": b"its bytes"})


def hand_eye(folder: Path, **changes: Any) -> None:
    """Of six images; with errors of the robot its poses are uncertain."""
    study = simulate_hand_eye(images=6, corners=(3, 3), pitch=80.0, seed=5, **changes).study
    if changes:
        width = [changes["position_error"]] * 3 + [changes["rotation_error"]] * 3
        study = replace(study, pose_half_width=np.tile(width, (6, 1)))
    save_hand_eye(study, folder / "study")
    command("handeye", "certify", folder / "study", "--within", "1.5,50", "-o", folder / "run")


def wrong_images(folder: Path) -> None:
    """The fifth of twelve images has a pose that is off by a centimetre."""
    study = simulate_hand_eye(images=12, corners=(3, 3), pitch=60.0, seed=11).study
    position = np.array(study.poses.position)
    position[4] += [8.0, -5.0, 4.0]
    save_hand_eye(replace(study, poses=Pose(position, study.poses.quaternion)), folder / "study")
    command("handeye", "certify", folder / "study", "--wrong", "1", "--within", "0.8,20", "-o", folder / "run")


def solve(folder: Path) -> None:
    (folder / "run").mkdir()
    (folder / "it.mbx").write_text(PROBLEM)
    command("solve", folder / "it.mbx", "--certificate", folder / "run" / "it.cert.jsonl", "-o", folder / "it.json")


RUNS: dict[str, Callable[[Path], None]] = {
    "leg": leg, "uncertain leg": uncertain_leg, "undecided leg": undecided_leg, "robust": robust,
    "compare": compare, "fits": fits, "accuracy": accuracy, "pose sets": pose_sets, "solve": solve,
    "hand-eye": hand_eye, "wrong images": wrong_images,
    "uncertain hand-eye": partial(hand_eye, position_error=0.1, rotation_error=0.001),
}  # fmt: skip


# what is damaged ------------------------------------------------------------------------------------------------------


def _input(save: Callable[[Any, Path], object], load: Callable[[Path], Any]) -> Callable[[Any, Any], str | None]:
    """Another input is harmless when it means what it says: saved and loaded it is the same."""

    def why(good: Any, found: Any) -> str | None:
        with tempfile.TemporaryDirectory() as folder:
            save(found, Path(folder) / "again")
            if load(Path(folder) / "again") != found:
                return None
        if isinstance(found, Campaign) and campaign_sha256(found) == campaign_sha256(good):
            return None
        differs = [f.name for f in fields(found) if not same(getattr(found, f.name), getattr(good, f.name))]
        return f"another input, which says so: {', '.join(differs)}"

    return why


def _record(folder: Path) -> None:
    study = simulate_study(seed=1, runs=3, random_poses=4, validation_runs=2)
    save_record(calibrate_study(study).record, folder)


def verified(folder: Path) -> tuple[list[str], dict[str, Any]]:
    """What `cpcal verify` says that is proved, without how long it took, and what the JSON files state besides."""
    run = folder / "run"
    done = CliRunner().invoke(app, ["verify", str(run)])
    said = done.stdout + done.stderr
    if done.exit_code in (Status.UNKNOWN, Status.UNUSABLE) and said.strip() and done.exception is not None:
        raise Refusal(said.splitlines()[0])
    assert done.exit_code == 0, said or repr(done.exception)
    lines = (re.sub(r"(, | \()\d+ steps\b|, [\d.]+ s\b", "", line) for line in done.stdout.splitlines())
    proved = sorted(line for line in lines if "PROVED" in line or "CERTIFIED" in line)
    files = sorted(run.rglob("*.json"))
    return proved, {str(path.relative_to(run)): _stated(json.loads(path.read_bytes())) for path in files}


def _stated(value: Any) -> Any:
    """Without the information, and without certificates' rows that prove a claim: these are no claims. A box's center
    to 13 digits: what is claimed is the certificate's box, whose ends are those of center +-delta, rounded outward."""
    if isinstance(value, dict):
        said = {key: _stated(part) for key, part in value.items() if key not in (INFORMATION, "chains")}
        if isinstance(center := said.get("center"), list):
            said["center"] = [f"{v:.13g}" for v in center]
        return said
    return [_stated(part) for part in value] if isinstance(value, list) else value


def _claimed_otherwise(kind: str) -> Callable[[Any, Any], str | None]:
    """Nothing is stated beside the certificates of `cpcal solve` and of fits: what they claim instead they prove."""
    said = "the certificate itself claims otherwise, and proves it" if kind in ("solve", "fits") else None
    return lambda good, found: said


SUBJECTS = {
    s.name: s
    for s in (
        Subject(
            "campaign", lambda folder: save_campaign(simulate(seed=1, extremal=False, random_poses=4, runs=2), folder),
            load_campaign, _input(save_campaign, load_campaign)),
        Subject(
            "study", lambda folder: save_study(
                simulate_study(seed=1, runs=1, random_poses=1, validation_runs=1, backlash=0.1, sag=0.5), folder),
            load_study, _input(save_study, load_study)),
        Subject(
            "target", lambda folder: save_target(DELTALAB_TARGET, folder / "target.toml"),
            lambda folder: load_target(folder / "target.toml"), _input(save_target, load_target)),
        Subject(
            "camera", lambda folder: save_camera(DELTALAB_CAMERA, folder / "camera.toml"),
            lambda folder: load_camera(folder / "camera.toml"), _input(save_camera, load_camera)),
        Subject("record", _record, load_record, _input(save_record, load_record)),
        *(Subject(kind, write, verified, _claimed_otherwise(kind), "run/**/[!.]*") for kind, write in RUNS.items()),
    )
}  # fmt: skip


# the survey -----------------------------------------------------------------------------------------------------------


def outcomes(subject: Subject, folder: Path, count: int, seed: int, apart: bool = False) -> Iterator[Outcome]:
    """The outcomes of `count` mutations of a subject, whose files are written into the empty `folder`.

    `apart`: each is read in a process of its own, which is measured.
    """
    subject.write(folder)
    files = {p: p.read_bytes() for p in sorted(folder.glob(subject.mutated)) if p.is_file() and p.stat().st_size}
    good = subject.read(folder)
    for number in range(count):
        rng = random.Random(f"{seed}/{subject.name}/{number}")
        path = rng.choice(list(files))
        name, content = mutated(rng, files[path])
        path.write_bytes(content)
        read = (subject, folder, good)
        (kind, why), seconds, megabytes = _apart(*read) if apart else (_outcome(*read), 0.0, 0.0)
        path.write_bytes(files[path])
        if kind not in BAD and (seconds > SECONDS or megabytes > MEGABYTES):
            kind, why = "COSTLY", f"{kind} after {seconds:.1f} s and {megabytes:.0f} MB"
        yield Outcome(number, path.name, name, kind, why, seconds, megabytes)


Measured = tuple[tuple[str, str], float, float]  # kind and reason, seconds of processor time, megabytes


def _apart(subject: Subject, folder: Path, good: Any) -> Measured:
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        found = _outcome(subject, folder, good)
        with os.fdopen(send, "wb") as stream:
            pickle.dump(found, stream)
        os._exit(0)
    os.close(send)
    with os.fdopen(receive, "rb") as stream:
        content = stream.read()
    _, status, used = os.wait4(child, 0)
    found = pickle.loads(content) if content and not status else ("TRACEBACK", f"the process ended with {status}")
    return found, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def _outcome(subject: Subject, folder: Path, good: Any) -> tuple[str, str]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a reader that says what looks odd
            found = subject.read(folder)
        if found == good:
            return "same", "everything that is claimed is as in the good files"
        why = subject.harmless(good, found)
        return ("CHANGED", "what is claimed differs") if why is None else ("other", why)
    except Refusal as refusal:
        return "refused", str(refusal)
    except InputError as error:
        named = error.problems and all(p.where and p.what and p.remedy for p in error.problems)
        return ("refused", str(error.problems[0])) if named else ("TRACEBACK", "a refusal without a remedy")
    except Exception as error:
        return "TRACEBACK", f"{type(error).__name__}: {error}"


def survey(name: str, count: int, seed: int, log: Callable[[str], object]) -> Counter[str]:
    """How many mutations of a subject had which outcome; every acceptance and every failure is logged."""
    found: Counter[str] = Counter()
    slowest = largest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for outcome in outcomes(SUBJECTS[name], Path(folder), count, seed, apart=True):
            found[outcome.kind] += 1
            slowest, largest = max(slowest, outcome.seconds), max(largest, outcome.megabytes)
            if outcome.kind != "refused":
                log(json.dumps({"subject": name, "seed": seed, **vars(outcome)}))
    counts = ", ".join(f"{times:,} {kind}" for kind, times in sorted(found.items()))
    print(f"{name}: {count:,} mutations, seed {seed}: {counts}; at most {slowest:.2f} s, {largest:.0f} MB", flush=True)
    return found


Names = Annotated[list[str] | None, typer.Argument(metavar="SUBJECT", help=f"of {', '.join(SUBJECTS)}; default: runs")]


def main(subjects: Names = None, count: int = 10_000, seed: int = 1, log: Path = Path("damaged_runs.jsonl")) -> None:
    names = asked(subjects, SUBJECTS) if subjects else list(RUNS)
    with log.open("w", encoding="utf-8", buffering=1) as file:
        total: Counter[str] = Counter()
        for name in names:
            total += survey(name, -(-count // len(names)), seed, lambda line: file.write(line + "\n"))
    print(f"all: {sum(total.values()):,} mutations: {', '.join(f'{n:,} {kind}' for kind, n in sorted(total.items()))}")
    sys.exit(1 if any(total[kind] for kind in BAD) else 0)


if __name__ == "__main__":
    run_by_hand(main)
