"""What is proved of a hand-eye study, in sentences; numbers rounded to the safe side."""

from __future__ import annotations

from cpcal.common.files import listed
from cpcal.common.numbers import at_least, at_most, bracket_text, nearest, stated
from cpcal.handeye.certify import PARAMETERS, HandEyeResult
from cpcal.handeye.wrong_images import WrongImages


def frames_of(setup: str) -> tuple[str, str]:
    """The names of X and F."""
    return ("camera in hand", "target in base") if setup == "eye-in-hand" else ("camera in base", "target in hand")


def names_of(setup: str) -> list[tuple[str, str]]:
    """Name and unit of each of PARAMETERS."""
    camera, target = frames_of(setup)
    named = {"camera": camera, "target": target}
    found = []
    for parameter in PARAMETERS:
        frame, axis = parameter.split()
        turned = axis.startswith("r")
        found.append((f"{named[frame]}: {'turn about ' + axis[1] if turned else axis}", "deg" if turned else "mm"))
    return found


def sentences(found: HandEyeResult) -> list[str]:
    """The answer in a few lines."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    turned = "any rotation" if found.asked.angle is None else f"rotations within {stated(found.asked.angle)} degrees"
    said = [
        f"{found.setup}: {found.images} images, {found.points:,} points. "
        f"Searched: {turned}, positions within {stated(found.asked.reach)} mm of the least-squares answer.",
    ]
    if found.uncertain:
        said.append("Robot poses are uncertain: a pixel is explained at some reading of its image's pose.")
    if found.eps_lo > 0.0:
        said.append(f"No frames explain every pixel to within {low} px (proved); some explain every one to {high} px.")
    else:
        said.append(f"Some frames explain every pixel to within {high} px (proved); nothing is proved from below.")
    if not found.complete:
        more = "more time (--time-limit)" if found.timed else "a smaller --within"
        said.append(f"The bracket is open: {more} may close it.")
    if found.tolerance is not None:
        word = {True: "met", False: "refuted: no frames in the box meet it", None: "undecided"}[found.passes]
        said.append(f"Tolerance {stated(found.tolerance)} px: {word}.")
    classical = found.classical
    failing = [verdict.image for verdict in classical.images if not verdict.ok]
    fit = "Least squares, at its own readings of the poses" if found.uncertain else "Least squares"
    said.append(
        f"{fit}: rms {nearest(found.rms, 3)} px, largest error {at_most(classical.largest, 4)} px; "
        f"over {at_least(found.ranges.eps, 4)} px in {len(failing)} of {found.images} images"
        + (f" ({listed(failing, 5)})." if failing else ".")
    )
    said += found.remarks
    if found.support:
        named = dict.fromkeys(image for image, _ in found.support)
        said.append(f"{len(found.support)} points of {len(named)} images force the lower end: {listed(named, 6)}.")
    if not found.ranges.empty:
        at = at_least(found.ranges.eps, 4)
        said.append(f"Every pair of frames that explains all pixels to {at} px lies here (proved):")
    return said


def wrong_sentences(found: WrongImages) -> list[str]:
    """What is proved when some images may be wrong, in a few lines."""
    low, high = at_least(found.eps_lo, 5), at_most(found.eps_hi, 5)
    left = ", ".join(found.left_out)
    said = [f"All images but {left} are explained to within {high} px by some frames (proved)."]
    if found.eps_lo > 0.0:
        which = "Whichever one is" if found.outliers == 1 else f"Whichever {found.outliers} are"
        said.append(f"{which} left out, no frames explain all others to {low} px (proved).")
    tolerance = at_most(found.asked_tolerance, 5)
    most = "one is" if found.outliers == 1 else f"{found.outliers} are"
    for image, _ in found.blamed:
        said.append(f"{image} is wrong, if at most {most} and right ones fit to {tolerance} px (proved).")
    proved = {image for image, _ in found.blamed}
    open_ = [image for image in found.left_out if image not in proved]
    if open_:
        said.append(f"Not proved to be wrong, though the others fit best without: {', '.join(open_)}.")
    return said
