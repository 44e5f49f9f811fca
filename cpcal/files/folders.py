"""Campaigns and studies in files (DESIGN section 8): canonical bytes; read with every problem at once and its line."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.documents import KeyPath, TomlReader, array, csv_table, document, name, whole, written
from cpcal.common.errors import YOUR_DATA, InputError, Problem, Problems, shown, unusable
from cpcal.common.files import NAME_MAX, StrPath, small_file, write_file, write_folder
from cpcal.common.values import Floats, Json, Texts, fill
from cpcal.files.tables import Table, read_table
from cpcal.robot import EXACT_OR_NOT, ROBOTS, Campaign, ModelChoice, Pose, PoseTable, Robot, Study, Truth, Uncertainty
from cpcal.robot.campaign import ARRAYS, QUATERNION_TOLERANCE, quaternion_problem
from cpcal.robot.robot import KINDS
from cpcal.robot.units import SHARED_COLUMNS, override_columns, reading_columns

# ------------------------------------------------------------------------------------------------------------------
# Campaigns to files: canonical bytes, their digest, and writing that never leaves anything half-written.

FORMAT = "cpcal-campaign/1"
TOML_NAME = "campaign.toml"
CSV_NAME = "measurements.csv"


def toml_bytes(campaign: Campaign) -> bytes:
    """The canonical campaign.toml; floats by repr, so that they are read back bit for bit."""
    uncertainty = {"exact": True}
    if (stated := campaign.uncertainty) is not None:
        suffix = "half_width" if stated.factor is None else "sigma"
        uncertainty = {"factor": stated.factor} | {f"{kind}_{suffix}": getattr(stated, kind) for kind in KINDS}
    asked = campaign.model
    model = {} if asked is None else {"name": asked.name, "half_widths": asked.half_widths}
    return document(
        FORMAT, {"robot": vars(campaign.robot), "uncertainty": uncertainty, "model": model}, campaign.provenance
    )


def csv_bytes(campaign: Campaign) -> bytes:
    """The canonical measurements.csv; an override column is there only where some row needs it."""
    radii = np.hstack([campaign.position_radius, campaign.rotation_radius, campaign.length_radius])
    stated = 0.0 if campaign.uncertainty is None else campaign.uncertainty.half_widths
    own = np.where(radii != stated, radii, np.array(None)).T.tolist()
    widths = zip(override_columns(campaign.legs), own, strict=True)
    return _rows(campaign, {}, {name: column for name, column in widths if any(v is not None for v in column)})


def _rows(
    of: Campaign | PoseTable, image: Mapping[str, Sequence[str]], more: Mapping[str, Sequence[float | None]]
) -> bytes:
    """A CSV table of names, readings and `more` columns."""
    values = np.hstack([of.position, of.quaternion, of.length]).T.tolist()
    names = {"pose": of.pose, "run": of.run, **image}
    columns = {**dict(zip(reading_columns(of.legs)[2:], values, strict=True)), **more}
    return csv_table([*names, *columns], zip(*names.values(), *columns.values(), strict=True))


def save_campaign(campaign: Campaign, path: StrPath) -> None:
    """Write the campaign's two files into the folder `path`, which is made if need be.

    A new folder appears complete or not at all. In an existing folder other files stay, and campaign.toml is
    taken away first and put back last: an interruption leaves a folder that is refused, never a mixture.
    """
    write_folder(Path(path), {CSV_NAME: csv_bytes(campaign), TOML_NAME: toml_bytes(campaign)}, head=TOML_NAME)


# ------------------------------------------------------------------------------------------------------------------
# Studies to files: canonical bytes, so that the same study is always the same files.

STUDY_FORMAT = "cpcal-study/2"
STUDY_NAME = "study.toml"
CALIBRATION_NAME = "calibration.csv"
VALIDATION_NAME = "validation.csv"


def save_study(study: Study, path: StrPath) -> None:
    """Write the study's three files into the folder `path`, which is made if need be.

    A new folder appears complete or not at all; in an existing one other files stay, and study.toml comes last.
    Raises InputError when the folder cannot be written.
    """
    contents = {
        CALIBRATION_NAME: table_bytes(study.calibration),
        VALIDATION_NAME: table_bytes(study.validation),
        STUDY_NAME: study_bytes(study),
    }
    write_folder(Path(path), contents, head=STUDY_NAME)


def study_bytes(study: Study) -> bytes:
    """The canonical study.toml; floats by repr, so that they are read back bit for bit."""
    simulated = {}
    if (truth := study.truth) is not None:
        frames = {"camera": truth.camera, "target": truth.target}
        poses = {name: {"position": of.position, "quaternion": of.quaternion} for name, of in frames.items()}
        simulated = {"seed": truth.seed, "parameters": truth.robot.parameters, **poses}
    return document(STUDY_FORMAT, {"robot": vars(study.robot), "truth": simulated}, study.provenance)


def table_bytes(table: PoseTable) -> bytes:
    """The canonical CSV of a table; columns of `image` and `shared` only where the table has them."""
    shared = () if table.shared is None else zip(SHARED_COLUMNS, table.shared.T.tolist(), strict=True)
    return _rows(table, {} if table.image is None else {"image": table.image}, dict(shared))


# ------------------------------------------------------------------------------------------------------------------
# Reads campaign.toml: every problem with its line number, whatever the state of the rest.

_ABSENT = "a campaign is a folder with the two files campaign.toml and measurements.csv"
_SIGMA_KEYS, _WIDTH_KEYS = (tuple(f"{kind}_{suffix}" for kind in KINDS) for suffix in ("sigma", "half_width"))
_STATED = (("factor", *_SIGMA_KEYS), _WIDTH_KEYS, ("exact",))


@dataclass(frozen=True)
class Settings:
    """What campaign.toml or study.toml says; `robot` is None where it is unusable, `uncertainty` also where readings
    are exact. `legs`: their number, as far as it can be told (to read on). `sha256`: of the file.
    """

    robot: Robot | None = None
    legs: int | None = None
    uncertainty: Uncertainty | None = None
    model: ModelChoice | None = None
    truth: Truth | None = None
    provenance: Texts = field(default_factory=dict)
    sha256: str = ""


def read_settings(path: Path, problems: Problems) -> Settings:
    """The settings in a campaign.toml; adds to `problems`."""
    reader = TomlReader.opened(path, FORMAT, ("robot", "uncertainty", "model"), problems, _ABSENT)
    if reader is None:
        return Settings()
    robot, legs = _robot(reader)
    remedy = 'add a name, such as name = "gain"'
    model = reader.section("model", {"name": _identifier}, {"half_widths": _widths}, needed=False, remedy=remedy)
    choice = None if model is None else ModelChoice(**model)
    stated = _uncertainty(reader, legs)
    return Settings(robot, legs, stated, choice, provenance=reader.provenance(), sha256=reader.sha256)


def _robot(reader: TomlReader) -> tuple[Robot | None, int | None]:
    """The robot, or None; and the number of its legs, as far as it can be told."""
    stated, keys = reader.document.get("robot"), ("base", "mobile", "offset")
    of = stated if isinstance(stated, dict) else {}
    legs = next((len(value) for key in keys if isinstance(value := of.get(key), list)), None)
    rows = array((legs, 3), "x, y and z in mm", by_leg=True)
    found = reader.section(
        "robot", {"name": name, "base": rows, "mobile": rows, "offset": array((legs,), "one for each leg")}
    )
    return (None if found is None else Robot(**found)), legs or None


def _uncertainty(reader: TomlReader, legs: int | None) -> Uncertainty | None:
    """The section [uncertainty], which says how far readings may be off, or that they are exact: None."""
    if "uncertainty" not in reader.document:
        reader.wrong((), "the section [uncertainty] is missing", EXACT_OR_NOT)
        return None
    each = ((3, "three, mm"), (3, "three, rad"), (legs, "one for each leg, mm"))
    reads = [array((count,), meaning, signed=False) for count, meaning in each]
    keys = {"factor": array((), signed=False), "exact": _exact}
    sizes = dict(zip((*_SIGMA_KEYS, *_WIDTH_KEYS), reads * 2, strict=True))
    found = reader.section("uncertainty", {}, {**keys, **sizes})
    if found is None:
        return None
    meant = max(_STATED, key=lambda ways: len(found.keys() & ways))
    for key in [key for key in meant if key not in found]:
        reader.wrong(("uncertainty",), f"the key {key!r} is missing in [uncertainty]", f"add {key}; {EXACT_OR_NOT}")
    for key in [key for key in found if key not in meant]:
        reader.wrong(("uncertainty", key), f"{key!r} is given beside {meant[0]!r}", EXACT_OR_NOT)
    if "exact" in meant or legs is None or found.keys() != {*meant}:
        return None
    given = (*(found[key] for key in meant[-3:]), found.get("factor"))
    # single values were checked: a product may overflow
    return reader.made(lambda: Uncertainty(*given), lambda _: ("uncertainty",))


def _exact(reader: TomlReader, path: KeyPath, value: object) -> bool:
    if value is not True:
        reader.wrong(path, f"exact is {shown(value)}", EXACT_OR_NOT)
    return True


def _identifier(reader: TomlReader, path: KeyPath, value: object) -> str:
    """Of a model or its parameter; which there are is known where they are used."""
    if not (isinstance(value, str) and value.isidentifier() and len(value) <= NAME_MAX):
        reader.wrong(path, f"{shown(value)} cannot be a name", "give a word, such as gain or s")
    return str(value)


def _widths(reader: TomlReader, path: KeyPath, value: object) -> dict[str, float]:
    if not isinstance(value, dict):
        reader.wrong(path, "half_widths is not a table", "write half_widths = { s = 0.05 }")
        return {}
    return {
        _identifier(reader, path, k): reader.number(path, f"the half-width of {shown(k)}", v, signed=False)
        for k, v in value.items()
    }


# ------------------------------------------------------------------------------------------------------------------
# Reads study.toml: every problem with its line number, whatever the state of the rest.

_NO_STUDY = "a study is a folder with the three files study.toml, calibration.csv and validation.csv"
_WHOLE = "add {key}, or take [truth] out"


def read_study_settings(path: Path, problems: Problems) -> Settings:
    """The settings in a study.toml; adds to `problems`."""
    reader = TomlReader.opened(path, STUDY_FORMAT, ("robot", "truth"), problems, _NO_STUDY)
    if reader is None:
        return Settings()
    robot, legs = _robot(reader)
    parameters = array((legs, 7), "ax, ay, az, bx, by, bz, l in mm", by_leg=True)

    keys = {"seed": whole(0), "parameters": parameters, "camera": _pose, "target": _pose}
    found = reader.section("truth", keys, needed=False, remedy=_WHOLE)
    truth = None
    if found is not None and robot is not None:
        found["robot"] = Robot.from_parameters(robot.name, found.pop("parameters"))
        truth = Truth(**found)
    return Settings(robot, legs, truth=truth, provenance=reader.provenance())


def _pose(reader: TomlReader, path: KeyPath, value: object) -> Pose | None:
    keys = {"position": array((3,), "x, y and z in mm"), "quaternion": array((4,), "qw, qx, qy and qz")}
    found = reader.table(path, value, keys, remedy=_WHOLE)
    if found is None:
        return None
    norm = math.hypot(*found["quaternion"])
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        reader.wrong((*path, "quaternion"), *quaternion_problem(norm))
    return Pose(**found)


# ------------------------------------------------------------------------------------------------------------------
# A commented campaign.toml to fill in: for a robot of the catalogue, or for one's own.

_LEGS_MAX = 1_000
_START = """\
# A campaign: what was measured on one robot. Beside this file stands measurements.csv; docs/your-data.md explains both.
# Every nan is to be replaced by a number. Lengths are in mm, angles in radians.
"""
_COMMENTS = {
    "base": "centres of the joints on the base, one row x, y, z a leg, mm, in the base frame",
    "mobile": "centres of the joints on the moving platform, one row a leg in the same order, mm, in the mobile frame",
    "offset": "what a reading lacks of the leg's length, mm: length = reading + offset; 0 where whole lengths are read",
}
_UNCERTAINTY = """
[uncertainty]
# How far readings may be off: half-width = factor * standard deviation. Or put the one line `exact = true` here.
factor = 3.0
position_sigma = [nan, nan, nan]    # x, y, z of the pose, mm
rotation_sigma = [nan, nan, nan]    # rotation vector in the base frame, rad (0.01 degrees are 0.000175)
"""
_REST = """
# [model]                             # the leg model; without it the plain one: see docs/models.md
# name = "gain"

[provenance]                          # free text, shown in reports
# date = "2026-01-31"
# operator = ""
# serial = ""
"""


def settings_template(name: str, legs: int) -> str:
    """The text of a campaign.toml: the drawing of a known robot, or nan for `legs` legs of one called `name`.

    Raises InputError for a name or a number of legs that cannot be.
    """
    known = ROBOTS.get(name.casefold())
    if known is None and not 1 <= legs <= _LEGS_MAX:
        raise unusable("option legs", f"has no meaning: {legs}", f"give 1 to {_LEGS_MAX}")
    blank = np.full((legs, 3), np.nan)
    robot = {"name": name, "base": blank, "mobile": blank, "offset": blank[:, 0]}
    lines = [f"{_START}format = {written(FORMAT)}", "", "[robot]"]
    if known is not None:
        robot = vars(known.robot)
        lines.append(f"# Dimensions: {known.source}")
    for key, value in robot.items():
        lines += [*([f"# {_COMMENTS[key]}"] if key in _COMMENTS else []), f"{key} = {written(value)}"]
    lengths = np.full(len(robot["offset"]), np.nan)
    uncertain = f"{_UNCERTAINTY}length_sigma = {written(lengths)}    # leg readings, mm, one for each leg"
    return "\n".join([*lines, uncertain, _REST])


# ------------------------------------------------------------------------------------------------------------------
# Campaigns from files: all problems of both files at once, each with its line.


def load_campaign(path: StrPath) -> Campaign:
    """The campaign in the folder `path`.

    campaign.toml states the nominal robot and, in [uncertainty], half-widths: as `factor` times
    `position_sigma` (3, mm), `rotation_sigma` (3, rad) and `length_sigma` (n, mm), or directly as
    `position_half_width`, `rotation_half_width` and `length_half_width`; or it says `exact = true` there. [model]
    may name the leg model that is asked for, and `half_widths` of its extra parameters. measurements.csv has the
    columns pose,run,x,y,z,qw,qx,qy,qz,L1..Ln in any order, and any of dx,dy,dz,drx,dry,drz,dL1..dLn, whose cells
    replace those half-widths where they are not empty.

    Raises one InputError that lists every problem of both files.
    """
    folder, problems = existing_folder(path, _ABSENT, YOUR_DATA), Problems()
    settings = read_settings(folder / TOML_NAME, problems)
    table = read_table(folder / CSV_NAME, settings.legs, problems, _ABSENT)
    problems.raise_any(YOUR_DATA)
    campaign = campaign_of_table(table, settings)
    fill(campaign, files=((TOML_NAME, settings.sha256), (CSV_NAME, table.sha256)))
    return campaign


def campaign_of_table(table: Table, settings: Settings) -> Campaign:
    """Of a table as measurements.csv has it: override columns count where they are not NaN."""
    robot, stated = settings.robot, settings.uncertainty
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    radii = np.zeros((len(table.names["pose"]), 6 + robot.legs))
    if stated is not None:
        radii[:] = stated.half_widths
    for column, key in enumerate(override_columns(robot.legs)):
        if key in table.values:
            own = ~np.isnan(table.values[key])
            radii[own, column] = table.values[key][own]
    numbers = np.hstack([table.columns(*reading_columns(robot.legs)[2:]), radii])
    return Campaign(
        robot,
        tuple(table.names["pose"]),
        tuple(table.names["run"]),
        **_arrays(numbers, robot.legs),
        uncertainty=stated,
        provenance=settings.provenance,
        model=settings.model,
    )


def _arrays(numbers: Floats, legs: int) -> Json:
    """`ARRAYS` of a campaign, which stand side by side in (N, 13 + 2 n) numbers."""
    return dict(zip(ARRAYS, np.split(numbers, np.cumsum([3, 4, legs, 3, 3]), axis=1), strict=True))


def existing_folder(path: StrPath, absent: str, see: str = "") -> Path:
    """The folder. Raises InputError where there is none."""
    folder = Path(path)
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise InputError([Problem(str(folder), what, absent)], see=see)
    return folder


def load_settings(path: StrPath) -> Settings:
    """What a campaign.toml, or that in a folder, says. Raises InputError with every problem of it."""
    file = Path(path) / TOML_NAME if Path(path).is_dir() else Path(path)
    problems = Problems()
    settings = read_settings(file, problems)
    problems.raise_any(YOUR_DATA)
    return settings


# ------------------------------------------------------------------------------------------------------------------
# A campaign in one file of exact numbers, `campaign.json`: what a run keeps, and what its certificates are tied to.
#
# docs/certificate-format.md has the format. A number is the float64 nearest to its decimal text, here as in
# campaign.toml and measurements.csv, so that reading the file gives the campaign back bit by bit.

CAMPAIGN_NAME = "campaign.json"
JSON_FORMAT = "cpcal-campaign-exact/1"
_LARGEST = 32 << 20  # bytes: the checker reads no more
_REMEDY = "certify the campaign again"


def campaign_json(campaign: Campaign) -> bytes:
    """The file's bytes: of equal campaigns from equal files, the same."""
    stated, model, files = campaign.uncertainty, campaign.model, campaign.files
    if not files:  # made in memory: those that `save_campaign` writes
        contents = (TOML_NAME, toml_bytes(campaign)), (CSV_NAME, csv_bytes(campaign))
        files = tuple((name, hashlib.sha256(content).hexdigest()) for name, content in contents)
    head = {
        "format": JSON_FORMAT,
        "files": [{"name": name, "sha256": digest} for name, digest in files],
        "robot": vars(campaign.robot),
        "uncertainty": stated and {key: getattr(stated, key) for key in ("factor", *KINDS)},
        "model": model and {"name": model.name, "half_widths": model.half_widths},
        "provenance": campaign.provenance,
    }
    numbers = np.hstack([getattr(campaign, name) for name in ARRAYS]).tolist()
    names = ([json.dumps(name)[1:-1] for name in given] for given in (campaign.pose, campaign.run))
    rows = ('","'.join([pose, run, *map(repr, row)]) for pose, run, row in zip(*names, numbers, strict=True))
    lines = [f"{json.dumps(key)}: {json.dumps(_texts(value))}" for key, value in head.items()]
    table = ",\n  ".join(f'["{row}"]' for row in rows)
    return ("{" + ",\n ".join([*lines, f'"measurements": [\n  {table}\n ]']) + "}\n").encode()


def campaign_sha256(campaign: Campaign) -> str:
    """SHA-256 of the bytes of campaign.json, in hex; computed once for each campaign."""
    if not campaign.digest:
        fill(campaign, digest=hashlib.sha256(campaign_json(campaign)).hexdigest())
    return campaign.digest


def save_campaign_json(campaign: Campaign, folder: StrPath) -> Path:
    """Write it into a folder, all or nothing; its path. Raises InputError, also where the checker could not read it."""
    content, path = campaign_json(campaign), Path(folder) / CAMPAIGN_NAME
    if len(content) > _LARGEST:
        what = f"takes {len(content):,} bytes as {CAMPAIGN_NAME}, more than {_LARGEST:,}"
        raise unusable("campaign", what, "certify parts of it, or without certificates")
    write_file(path, content)
    return path


def keep_beside(campaign: Campaign, certificate: StrPath) -> None:
    """Keep the campaign's file in the folder of a certificate. Raises InputError where another campaign's is there."""
    path = Path(certificate).parent / CAMPAIGN_NAME
    if not path.exists():
        save_campaign_json(campaign, path.parent)
    elif path.read_bytes() != campaign_json(campaign):
        raise unusable(path, "is of another campaign", "choose another folder for the certificate")


def load_campaign_json(path: StrPath, *, checked: bool = False) -> Campaign:
    """The campaign of a file, or of the `campaign.json` in a folder. Raises InputError, also where the file is not as
    cpcal writes it, unless the checker has read it."""
    file = Path(path) / CAMPAIGN_NAME if Path(path).is_dir() else Path(path)
    content = small_file(file, "name the folder of a run", most=_LARGEST)
    try:
        data = json.loads(content.decode("utf-8"))
        if not isinstance(data, dict) or data.get("format") != JSON_FORMAT:
            raise ValueError(f"is not of format {JSON_FORMAT}")
        campaign = _campaign(data)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise unusable(file, f"cannot be used: {error!r}", _REMEDY) from None
    if not checked and campaign_json(campaign) != content:
        raise unusable(file, "is not as cpcal writes it", _REMEDY)
    return campaign


def _campaign(data: Json) -> Campaign:
    robot, stated, asked = Robot(**data["robot"]), data["uncertainty"], data["model"]
    rows: list[list[str]] = data["measurements"]
    given = chain.from_iterable(row[2:] for row in rows)
    numbers = np.fromiter(map(float, given), np.float64).reshape(len(rows), -1)
    if stated is not None and stated["factor"] is not None:
        stated["factor"] = float(stated["factor"])
    campaign = Campaign(
        robot=robot,
        pose=tuple(row[0] for row in rows),
        run=tuple(row[1] for row in rows),
        uncertainty=stated and Uncertainty(**stated),
        provenance=data["provenance"],
        model=asked and ModelChoice(**asked),
        **_arrays(numbers, robot.legs),
    )
    fill(campaign, files=tuple((file["name"], file["sha256"]) for file in data["files"]))
    return campaign


def _texts(value: Any) -> Any:
    """Numbers by repr, in arrays, lists and tables; texts as they are."""
    if isinstance(value, Mapping):
        return {key: _texts(one) for key, one in value.items()}
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == np.float64:
        return list(map(repr, value.tolist()))
    if isinstance(value, np.ndarray | list):
        return [_texts(one) for one in value]
    return value if value is None or isinstance(value, str) else repr(float(value))


# ------------------------------------------------------------------------------------------------------------------
# Studies from files (docs/calibration.md): all problems of the three files at once, each with its line.


def load_study(path: StrPath) -> Study:
    """The study in the folder `path`.

    study.toml states the nominal robot and, of a simulated study, the truth; calibration.csv and validation.csv have
    the columns pose,run,x,y,z,qw,qx,qy,qz,L1..Ln in any order, and perhaps image and shared_sx..shared_srz:
    the target frame in the camera frame (mm, unit quaternion), the readings (mm), and the deviations of shared errors.

    Raises one InputError that lists every problem of the three files.
    """
    folder, problems = existing_folder(path, _NO_STUDY), Problems()
    settings = read_study_settings(folder / STUDY_NAME, problems)
    tables = []
    for file in (CALIBRATION_NAME, VALIDATION_NAME):
        found = read_table(
            folder / file, settings.legs, problems, _NO_STUDY, optional=lambda _: ["image", *SHARED_COLUMNS]
        )
        missing = [column for column in SHARED_COLUMNS if column not in found.values]
        if found.values and 0 < len(missing) < len(SHARED_COLUMNS):
            what, remedy = f"the column {missing[0]!r} is missing", f"give all of {', '.join(SHARED_COLUMNS)}, or none"
            problems.wrong(folder / file, what, remedy, 1)
        tables.append(found)
    problems.raise_any()
    robot = settings.robot
    assert robot is not None  # what keeps it from being read is a problem, and was raised
    poses = []
    for found in tables:
        pose, run, *image = (tuple(found.names[name]) for name in ("pose", "run", "image") if name in found.names)
        shared = found.columns(*SHARED_COLUMNS) if SHARED_COLUMNS[0] in found.values else None
        position, quaternion, length = np.split(found.columns(*reading_columns(robot.legs)[2:]), [3, 7], axis=1)
        poses.append(PoseTable(pose, run, position, quaternion, length, image[0] if image else None, shared))
    return Study(robot, poses[0], poses[1], settings.truth, settings.provenance)
