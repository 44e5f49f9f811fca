"""Runs of hand-eye calibration: every number that they state is claimed by a certificate, or computed again here.

docs/certificate-format.md, "Hand-eye", is the specification. A certificate is of one stage of a study: the poses that
single images allow, what links them, or the pixels of all images. It begins with the box that was asked for, or where
the certificate that it names ended, and may use the poses that those of images claim.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction as F
from hashlib import sha256
from math import inf, nextafter, pi
from pathlib import Path
from typing import Any

from .bounds import Bounds, between, longest, matrix, number, numbers, skew
from .bounds import rotation as enclosed_rotation
from .certificate import FORMAT, Accepted, Certificates
from .files import HAND_EYE_NAME, STUDY_NAME, WORK, Budget, Lines, content, parsed
from .frames import (
    E_,
    GIVEN,
    R_F,
    R_X,
    SIZE,
    STAGES,
    T_F,
    T_X,
    Known,
    Rows,
    Study,
    Vector,
    asked_box,
    before_camera,
    holds,
    rotation,
    unit,
)
from .lens import LENSES, distorted
from .polynomial import applied, minus, plus, product, transposed
from .readers import (
    STRANGE,
    Json,
    Names,
    Refused,
    Unusable,
    anything,
    array,
    ascending,
    choice,
    compare,
    dyadic,
    entry,
    exact,
    finite,
    many,
    maybe,
    reading,
    reason_of,
    record,
    same,
    shown,
    text,
    up,
    whole,
)
from .rule import Box, Problem, hitting_set

STUDY_FORMAT = "cpcal-study/1"
# 12 images of any rotation take 9,000,000 units
_WORK = 2 * WORK  # of a run: its units take half as long as those of legs
_POINTS, _POINT_WORK, _MOST_POINTS = 10_000, 2_000, 20_000  # of a run: more for each point beyond so many
_ERRORS_WORK = 2_000  # of a point: what its lens and its errors at two pairs of frames cost
HAND_EYE_FORMAT = "cpcal-handeye-result/8"
BEYOND = 1.1, 1.01  # of eps_hi: the tolerance of ranges that nobody asked for, and where that leaves a turn open
_LENS = F(1, 10**7)  # px: how far a pixel and the image of its undistorted one may be apart
_SETUPS = ("eye-in-hand", "eye-to-hand")
Readings = Sequence[Vector]

_HEADER = record(
    {
        "format": choice(FORMAT),
        "study": text,
        "stage": choice(*STAGES),
        "images": ascending(1 << 20),
        "eps": dyadic,
        "asked": anything,
        "after": maybe(text),
        "poses": many(text),
    }
)
_BOX = record(
    {
        "center": many(dyadic, 14),
        "reach": dyadic,
        "angle": maybe(dyadic),
        "known": many(entry(choice(*GIVEN), dyadic, dyadic)),
        "hand": many(dyadic, 3),
        "board": many(dyadic, 3),
    }
)
_Asked = tuple[Vector, F, F | None, Known]  # the box: of `asked_box`, but for w and c


def _asked(header: Json) -> tuple[_Asked, Vector, Vector]:
    """The box that a certificate begins with, w and c."""
    *box, hand, board = _BOX({"known": []} | header["asked"])
    return (*box,), hand, board


# the study ----------------------------------------------------------------------------------------------------------


def _study(data: Json) -> Study:
    same("format", data["format"], STUDY_FORMAT)
    camera, setup = data["camera"], choice(*_SETUPS)(data["setup"])
    names, *poses = zip(*many(entry(text, *[exact] * 13))(data["images"]), strict=True)
    image, labels, *places = zip(*many(entry(whole(len(names)), text, *[exact] * 8))(data["points"]), strict=True)
    focal, center = (many(exact, 2)(camera[key]) for key in ("focal", "center"))
    if min(focal) <= 0:
        raise Refused("holds no camera")
    if len(set(names)) < len(names) or len(set(zip(image, labels, strict=True))) < len(image):
        raise Refused("holds an image, or a point of an image, twice")
    if min(map(min, [*poses[7:], places[7]])) < 0 or not all(map(any, zip(*poses[3:7], strict=True))):
        raise Refused("holds a negative half-width, or a quaternion that is no rotation")
    rows, turns, widths, pixels, rays, points = (
        tuple(zip(*part, strict=True))
        for part in (poses[:3], poses[3:7], poses[7:], places[:2], places[2:4], places[4:7])
    )
    study = Study(
        setup == _SETUPS[0], focal, center, names, tuple(zip(rows, turns, strict=True)), widths,
        image, labels, rays, points, places[7],
    )  # fmt: skip
    model = choice(*LENSES)(camera["model"])
    undistorted, measured = (
        [numbers((v - c) / f for v, c, f in zip(at, center, focal, strict=True)) for at in part]
        for part in (rays, pixels)
    )
    lens = distorted(model, many(exact, LENSES[model])(camera["distortion"]), undistorted)
    for found, true in zip(lens, measured, strict=True):  # the only one, as far out as any of them, that it moves there
        if any(f * off.size.ends[1] > _LENS for f, off in zip(focal, minus(found, true), strict=True)):
            raise Refused("holds an undistorted pixel that is another one")
    return study


# given frames -------------------------------------------------------------------------------------------------------


def errors(study: Study, placed: Vector, readings: Readings = ()) -> list[F | None]:
    """For each image the largest excess `|residual| - half-width` of its points on either axis, from 0, px; None where
    a point is not in front of the camera.

    `placed` (14): position and quaternion of X, then of F; `readings`: (d, w) of each pose, or at the stated ones.
    """
    (x_place, x_turn), (f_place, f_turn) = ((placed[k : k + 3], _turn(placed[k + 3 : k + 7])) for k in (0, 7))
    maps = []
    for k, (place, turned) in enumerate(study.poses):
        turn = _turn(turned)
        if readings:
            turn = product(_turn([F(1), *(v / 2 for v in readings[k][3:])]), turn)
            place = plus(place, readings[k][:3])
        if study.in_hand:  # H = (R, P)^-1
            turn = transposed(turn)
            place = [-v for v in applied(turn, place)]
        maps.append(before_camera(x_turn, [F(0)] * 3, f_turn, f_place, turn, minus(place, x_place)))
    found: list[F | None] = [F(0)] * len(maps)
    for image, ray, p, width in zip(study.image, study.rays, study.points, study.half_width, strict=True):
        x, y, z = plus(applied(maps[image][0], p), maps[image][1])
        off = (
            abs(f * a / z - (v - c)) if z else F(0)
            for f, a, v, c in zip(study.focal, (x, y), ray, study.center, strict=True)
        )
        before = found[image]
        found[image] = max(before, max(off) - width) if z > 0 and before is not None else None
    return found


def _turn(q: Vector) -> Sequence[Vector]:
    rows, norm = rotation(q)
    return [[F(v, norm) for v in row] for row in rows]


def parameter_ranges(lo: Vector, hi: Vector, about: Vector) -> tuple[list[float], list[float]]:
    """Lower and upper ends (12): position in mm, turn in degrees from the frames `about` (14), of X and of F.

    Turns are the rotation vectors w, in degrees, of all rotations exp([w]) C in a box of matrices; +-180 beyond 60
    degrees. M = R C' lies in a box. Its skew part is sin(theta) times the axis, and |M - I|^2 = 8 sin^2(theta / 2); so
    with k = sin(theta / 2) <= 1/2, w is the skew part times theta / sin(theta), which lies between 1 and
    1 / (1 - theta^2 / 6); theta <= 2 k / sqrt(1 - k^2).
    """
    low, high = list[float](), list[float]()
    for place, turn, shift in ((0, R_X, T_X), (7, R_F, T_F)):
        low += [-up(-lo[i]) for i in shift]
        high += [up(hi[i]) for i in shift]
        turns, k2 = _turned([between(lo[i], hi[i]) for i in turn], about[place + 3 : place + 7])
        if k2 > F(1, 4):
            low += [-180.0] * 3
            high += [180.0] * 3
            continue
        factor = 1 / (1 - 4 * k2 / (1 - k2) / 6)
        for sine in skew(turns):
            low.append(-_degrees(-sine.ends[0] / 2, factor))
            high.append(_degrees(sine.ends[1] / 2, factor))
    return low, high


def known_point(lo: Vector, hi: Vector, hand: Vector, at: Vector, about: Vector) -> tuple[float, float]:
    """How far at most frames in a box put a point (3, mm, in the camera frame), and turn the camera, from where the
    frames `about` (14) do: mm and degrees, 180 where no turn is excluded.

    X = (R, t) puts p at R p + t = w + R (p - e), with w = `hand`. Two of them, the second with an index 0, are at most
    `|e - e0| + |(R - R0) (p - e0)|` apart, and at most `|t - t0| + |(R - R0) p|`: the less of both counts.
    """
    turn, shift = _turn(about[3:7]), about[:3]
    e = applied(transposed(turn), minus(hand, shift))

    def off(places: Iterable[int], values: Iterable[F]) -> list[Bounds]:
        return [between(lo[i] - v, hi[i] - v) for i, v in zip(places, values, strict=True)]

    turned = matrix(off(R_X, (v for row in turn for v in row)))
    ways = (
        longest(off(places, known)) + longest(applied(turned, numbers(minus(at, origin))))
        for places, known, origin in ((E_, e, e), (T_X, shift, (F(0),) * 3))
    )
    k2 = _turned([between(lo[i], hi[i]) for i in R_X], about[3:7])[1]
    angle = 180.0 if k2 > F(1, 4) else _degrees(number(4 * k2 / (1 - k2)).root.ends[1], F(1))
    return up(min(way.ends[1] for way in ways)), angle


def _turned(turn: Sequence[Bounds], about: Vector) -> tuple[Sequence[Sequence[Bounds]], F]:
    """Rotations (9) times the inverse of the quaternion `about`, and an upper bound of sin(theta / 2)^2 of these."""
    turns = product(matrix(turn), transposed(enclosed_rotation(numbers(about))))
    return turns, sum(((turns[a][b] - number(a == b)).size.ends[1] ** 2 for a in range(3) for b in range(3)), F(0)) / 8


def _degrees(sine: F, factor: F) -> float:
    """An upper bound in degrees of a component, whose sine-weighted value is at most this."""
    value = sine * factor if sine >= 0 else sine  # of a negative one the factor 1 is the safe one
    return up(value * 180 / F(nextafter(pi, 0.0 if value >= 0 else inf)))


# certificates -------------------------------------------------------------------------------------------------------


class HandEyeCertificates(Certificates):
    """About one study."""

    def __init__(self, folder: Path, study: Study, digest: str, budget: Budget) -> None:
        super().__init__(folder, budget)
        self.study, self.digest = study, digest

    def form(self, header: Json, lines: Lines) -> tuple[Problem, Box]:
        given = _, digest, stage, images, eps, _, after, poses = _HEADER(header)
        if digest != self.digest:
            raise Refused("the study is another one: its SHA-256 differs", "campaign")
        if not images or images[-1] >= len(self.study.images) or (stage == "image") != (len(images) == 1):
            raise Refused("there are no such images")
        asked, hand, board = _asked(header)
        center, reach, *_ = asked
        if min(eps, reach) < 0 or not any(center[3:7]) or not any(center[10:]):
            raise Refused("eps, or the box that was asked for, is none")
        frames = asked_box(*asked, hand, board)
        if after is not None:
            frames = self._enclosure(after, given, ("links", "frames"))
        sets = {}
        for name in poses:
            box = self._enclosure(name, given, ("image",))
            sets[_HEADER(self.accepted(name).header)[3][0]] = box.lo, box.hi
        if len(sets) < len(poses) or (stage == "image" and (poses or after)) or not sets.keys() <= set(images):
            raise Refused("it rests on poses of other images")
        rows = Rows(self.study, stage, images, eps, hand, board, sets, Box(frames.lo[:SIZE], frames.hi[:SIZE]))
        return rows.problem(self.budget.spend), rows.root

    def _enclosure(self, name: str, header: list[Any], stages: Names) -> Box:
        """The box that another certificate claims, which may be used here: of no more images, at no smaller eps."""
        accepted = self.accepted(name)
        other = _HEADER(accepted.header)
        if other[2] not in stages or other[5] != header[5] or other[4] < header[4] or not {*other[3]} <= {*header[3]}:
            raise Refused(f"it rests on {shown(name)}, which is about something else")
        if accepted.claims.enclosure is None:
            raise Refused(f"it rests on {shown(name)}, which claims no box")
        return Box(*accepted.claims.enclosure)


def _placed(given: Json) -> list[F]:
    keys = (("camera_position", 3), ("camera_quaternion", 4), ("target_position", 3), ("target_quaternion", 4))
    found = [exact(v) for key, n in keys for v in array(given[key], n)]
    if not any(found[3:7]) or not any(found[10:]):
        raise Refused("states a quaternion of no rotation")
    return found


# runs ---------------------------------------------------------------------------------------------------------------


def check_hand_eye(folder: Path, *, work: int = 0) -> list[tuple[bool, str]]:
    """For each statement of a run whether it is accepted, and a sentence. Raises Unusable, Refused for the whole.

    `work`: what the check of all certificates may cost; 0 for what such a study needs.
    """
    run, found = _Run(folder, work), []
    for one in (run.box, run.ranges, run.lower_end, run.upper_end, run.least_squares, run.wrong_images, run.files):
        try:
            sentence = one()
            found += [(True, sentence)] if sentence else []
        except (Unusable, Refused, *STRANGE) as error:
            found.append((False, f"{one.__name__.replace('_', ' ')}: REFUSED, it {reason_of(error)}"))
    return found


def run_budget(points: int, work: int = 0) -> Budget:
    """What the check of a run of so many points may cost, less what these do. Raises Refused where there are too many.

    `work`: all that it may cost, where that is stated.
    """
    if points > _MOST_POINTS:
        raise Refused(f"holds more than {_MOST_POINTS} points", "limit")
    budget = Budget(work or _WORK + _POINT_WORK * max(0, points - _POINTS))
    budget.spend(_ERRORS_WORK * points)
    return budget


class _Run:
    """A study, a box, and what is stated of the images that are not left out, from certificates or at given frames."""

    def __init__(self, folder: Path, work: int) -> None:
        given = content(folder / STUDY_NAME)
        with reading(STUDY_NAME):
            data = parsed(given, finite)
            budget = run_budget(len(array(data["points"])), work)
            self.study = _study(data)
        self.certificates = HandEyeCertificates(folder, self.study, sha256(given).hexdigest(), budget)
        self.result = parsed(content(folder / HAND_EYE_NAME), finite)
        with reading(HAND_EYE_NAME):
            same("format", self.result["format"], HAND_EYE_FORMAT)
            asked: Json = self.result["asked"]
            center, reach, angle = _placed(asked["center"]), exact(asked["reach"]), maybe(exact)(asked["angle"])
            known = many(entry(choice(*GIVEN), exact, exact))(asked["known"])
            self.asked: _Asked = tuple(center), reach, angle, known
            self.given = ", if the given values are true" if known else ""
            if not 0 < reach < 10**6 or not (angle is None or 0 < angle <= 180):
                raise Refused("states a box that is none")

    def outliers(self) -> int:
        return int(whole(len(self.study.images))(self.result["outliers"]))

    def kept(self) -> list[int]:
        """The images that the point explains."""
        left, images = array(self.result["left_out"]), self.study.images
        if not len(left) == len(set(left)) == self.outliers() or not set(left) < set(images):
            raise Refused("leaves out other images than may be")
        return [k for k, name in enumerate(images) if name not in left]

    def tolerance(self) -> F:
        """That of ranges, of verdicts on images, and at which images are wrong."""
        eps, asked = exact(self.result["eps"]), self.result["tolerance"]
        hi = float(exact(self.result["eps_hi"]))
        if eps not in ([F(share * hi) for share in BEYOND] if asked is None else [exact(asked)]):
            raise Refused("is at another tolerance than was asked for")
        return eps

    def accepted(self, name: Any, eps: F, images: Sequence[int]) -> tuple[Accepted, Vector]:
        """A certificate about these images and the box that was asked for, at a tolerance; and its w."""
        accepted = self.certificates.accepted(name)
        header = _HEADER(accepted.header)
        box, hand, _ = _asked(accepted.header)
        if box != self.asked:
            raise Refused(f"rests on {shown(name)}, which speaks of another box")
        if header[4] != eps:
            raise Refused(f"rests on {shown(name)}, which is at another tolerance")
        if not {*header[3]} <= {*images}:
            raise Refused(f"rests on {shown(name)}, which is about other images")
        return accepted, hand

    def refuted(self, groups: Any, eps: F, beside: str | None = None) -> list[Accepted]:
        """Raises Refused unless, whichever images but the one `beside` are wrong, some group of right ones is left."""
        family, claims = [], []
        for group in array(groups):
            numbers = [self.study.images.index(name) for name in array(group["images"])]
            if len(set(numbers)) < len(numbers):
                raise Refused("names an image of a group twice")
            if beside is not None and beside not in group["images"]:
                raise Refused("has a group without the image that it names")
            claims.append(self.accepted(group["certificate"], eps, numbers)[0])
            if not claims[-1].claims.infeasible:
                raise Refused("rests on a certificate that does not claim that there are no frames")
            family.append(frozenset(name for name in group["images"] if name != beside))
        if len(set(family)) < len(family):
            raise Refused("names a group of images twice")
        if not family or hitting_set(family, self.outliers(), self.certificates.budget.spend) is not None:
            raise Refused("has groups of images that so many wrong ones could spoil")
        return claims

    def errors(self, placed: Vector, given: Any) -> list[F | None]:
        """Those of all images at frames and the readings that are stated with them."""
        readings = [[exact(v) for v in array(one, 6)] for one in array(given)]
        if readings and not self.study.uncertain:
            raise Refused("states readings of poses that are exact")
        if self.study.uncertain and len(readings) != len(self.study.images):
            raise Refused("states readings that are not those of the study's poses")
        for one, widths in zip(readings, self.study.widths, strict=False):
            if any(abs(v) > width for v, width in zip(one, widths, strict=True)):
                raise Refused("states a reading of a pose that is beyond its half-width")
        return errors(self.study, placed, readings)

    # statements

    def files(self) -> str:
        """No certificate lies about that nothing rests on."""
        self.certificates.names_all(self.certificates.known)
        return ""

    def box(self) -> str:
        study, result, kept = self.study, self.result, self.kept()
        proved = [len(study.images), len(study.image), _SETUPS[0] if study.in_hand else _SETUPS[1]]
        compare(("study", result[key], b) for key, b in zip(("images", "points", "setup"), proved, strict=True))
        _, *numbers, known = self.asked
        reach, angle = (None if v is None else repr(float(v)).removesuffix(".0") for v in numbers)
        turned = "any rotation" if angle is None else f"rotations within {angle} degrees"
        without = f", without {', '.join(result['left_out'])}" if len(kept) < len(study.images) else ""
        ends = (f"{name} from {float(low)!r} to {float(high)!r} {unit(name)}" for name, low, high in known)
        given = f"; given, not proved: {', '.join(ends)}" if known else ""
        return f"box: {turned}, positions within {reach} mm of its centre{without}{given}"

    def ranges(self) -> str:
        ranges, eps = self.result["ranges"], self.tolerance()
        if ranges is None:
            return ""
        accepted, hand = self.accepted(ranges["certificate"], eps, self.kept())
        claims, sides, known = accepted.claims, [ranges[key] for key in ("lo", "hi", "low", "high")], ranges["known"]
        what = f"every pixel{self.others()} to {float(eps)!r} px{self.given} ({accepted.steps} steps)"
        if claims.infeasible:
            compare([*(("ranges", side, []) for side in sides), ("point before the camera", known, None)])
            return f"ranges: PROVED, no frames explain {what}"
        if claims.enclosure is None or len(claims.enclosure[0]) < SIZE:
            raise Refused("rests on a certificate that claims no box of frames")
        lo, hi = (list(side[:SIZE]) for side in claims.enclosure)
        point = _placed(self.result["point"])
        found: list[list[Any]] = [lo, hi, *parameter_ranges(lo, hi, point)]
        for name, side, proved in zip(["box of the unknowns"] * 2 + ["ranges"] * 2, sides, found, strict=True):
            same(name, side, proved)
        place, turn = known_point(lo, hi, hand, [exact(v) for v in array(known["at"], 3)], point)
        compare([("place of a point", known["place"], place), ("turn", known["turn"], turn)])
        return f"ranges: PROVED for all frames that explain {what}"

    def lower_end(self) -> str:
        result, study, count = self.result, self.study, self.outliers()
        eps, groups = exact(result["eps_lo"]), result["lower"]
        if not array(groups):
            compare([("eps_lo", eps, 0), ("support", result["support"], [])])
            return "lower end: NOT CERTIFIED, eps >= 0"
        claims = self.refuted(groups, eps)
        points = dict.fromkeys(k for one in claims for side, k, _ in one.last if side[0] in "uv")
        same("support", result["support"], [[study.images[study.image[k]], study.names[k]] for k in points])
        which = "image is" if count == 1 else f"{count} images are"
        wrong = f"whichever {which} wrong, no frames explain all others" if count else ""
        steps = f"{sum(one.steps for one in claims)} steps" + (f", {len(groups)} groups" if count else "")
        return (
            f"lower end: PROVED, {wrong or 'no frames explain every pixel'} to {float(eps)!r} px{self.given} ({steps})"
        )

    def upper_end(self) -> str:
        """eps_hi, computed again at the point."""
        point, kept, worst = _placed(self.result["point"]), self.kept(), F(0)
        for k, one in enumerate(self.errors(point, self.result["readings"])):
            if one is None and k in kept:
                raise Refused("states a point that puts the target behind the camera")
            worst = worst if one is None or k not in kept else max(worst, one)
        if exact(self.result["eps_hi"]) != up(worst):
            raise Refused("states an eps_hi that is not the largest error of a pixel at the point")
        if not holds(point, *self.asked):
            raise Refused("states a point that is not in the box")
        return f"upper end: PROVED, the point explains every pixel{self.others()} to {up(worst)!r} px"

    def least_squares(self) -> str:
        said, eps, kept = self.result["classical"], self.tolerance(), set(self.kept())
        worst, failing, found = F(0), 0, self.errors(self.asked[0], said["readings"])
        same("number of images", len(said["images"]), len(found))
        for k, (name, verdict, one) in enumerate(zip(self.study.images, said["images"], found, strict=True)):
            if one is None and k in kept:
                raise Refused(f"puts points of {shown(name)} behind the camera")
            stated, ok = verdict["largest"], one is not None and one <= eps
            compare([
                ("image", verdict["image"], name), ("verdict on an image", verdict["ok"], ok),
                ("error in an image", stated, None if one is None else up(one)),
            ])  # fmt: skip
            worst, failing = max(worst, one or F(0)) if k in kept else worst, failing + (not ok)
        same("largest error", said["largest"], up(worst))
        return f"least squares: PROVED, over {float(eps)!r} px in {failing} of {len(found)} images"

    def wrong_images(self) -> str:
        blamed, count = array(self.result["blamed"]), self.outliers()
        named = [image for image, _ in blamed]
        if not blamed:
            return "wrong images: none is named" if count else ""
        eps = self.tolerance()
        if len(set(named)) < len(named) or not set(named) <= set(self.result["left_out"]):
            raise Refused("names an image that is not left out, or twice")
        for image, reasons in blamed:
            self.refuted(reasons, eps, image)
        return f"wrong images: PROVED if at most {count} are, at {float(eps)!r} px{self.given}: {', '.join(named)}"

    def others(self) -> str:
        return f" but those of {', '.join(self.result['left_out'])}" if self.result["left_out"] else ""
