"""Certificates of pose sets: the last stage, proved again by exact rational arithmetic (docs/certificate-format.md).

A certificate states polynomial rows in W and s of its own: those of `pose_rows` that the proof uses, exact numbers. It
claims that all (W, s) of a stated box that satisfy the rows lie in a smaller box (or that there are none); its text
tells what the unknowns mean. That the pixel boxes imply the rows and the stated box (lens, homography) is proved by
interval arithmetic on the way and is not in the certificate; when the homography alone shows that there is no pose,
the certificate states its linear rows.
"""

from __future__ import annotations

import os
from itertools import islice

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.robot import Pose
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.certificate.statement import limits
from cpcal.solver.contract import Repeat
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.search import Contracting, Divide, LargestFirst, Search
from cpcal.vision.pose_sets.pose_enclosure import Found, View, first_box, pose_network
from cpcal.vision.pose_sets.pose_rows import PoseBox
from cpcal.vision.pose_sets.proved_homography import homography_network

_PASSES = 6
_PAYS = 0.95


def write_certificate(path: str | os.PathLike[str], view: View, found: Found) -> Found:
    """Prove what was found once more, in writing: a box that is proved by the certificate, a little wider than `found`.

    Nothing is written when nothing was found. Raises ModelError when the contractors give no weights, or when no
    certificate of what was found could be made.
    """
    if isinstance(found, str):
        return found
    if found is None:
        _write_refutation(path, view)
        return None
    start = first_box(view)
    moved = start.about(found.center) if isinstance(start, PoseBox) else None
    if moved is None:
        raise ModelError("no certificate: the proof cannot be repeated about the centre of the set")
    proved = _recorded(path, view, pose_network(view, moved, moved.unknowns), _meaning(view, moved.center))
    if proved.is_empty:
        raise ModelError("no certificate: a second proof contradicts the first one")  # pragma: no cover - cannot be
    return moved.with_unknowns(proved)


def _write_refutation(path: str | os.PathLike[str], view: View) -> None:
    start = first_box(view)
    if isinstance(start, PoseBox):
        network, about = pose_network(view, start, start.unknowns), _meaning(view, start.center)
    else:
        network, about = homography_network(view.dots, view.pyramids), _HOMOGRAPHY
    if not _recorded(path, view, network, about).is_empty:
        os.remove(path)
        raise ModelError("no certificate: the rows in their rounded form do not exclude all poses")


_HOMOGRAPHY = (
    "cpcal pose set: X_A, Y_A, X_B, Y_B, X_C, Y_C, Z_A, Z_B of three dots in the camera frame, "
    "divided by Z_A + Z_B + Z_C"
)


def _meaning(view: View, center: Pose) -> str:
    """What the unknowns are, exactly."""
    numbers = {
        "P0": center.position,
        "q0": center.quaternion,
        "camera position": view.frames.camera.position,
        "camera quaternion": view.frames.camera.quaternion,
        "target position": view.frames.target.position,
        "target quaternion": view.frames.target.quaternion,
    }
    told = "; ".join(f"{name} = {' '.join(float(v).hex() for v in values)}" for name, values in numbers.items())
    return f"cpcal pose set: P = P0 + W / (1 + s.s) mm, R = R(1, s) R(q0) of the mobile in the base frame; {told}"


def _used(view: View, network: ConstraintNetwork) -> ConstraintNetwork:
    """The network with the rows that carry a step of some pass; all others only make a certificate longer."""
    steps = Repeat(view.contractor(network), _PAYS, _PASSES).contract(network.domain).steps
    carrying = sorted({k for step in steps for _, k in step.rows})
    return restricted(network, [np.array(carrying, dtype=np.intp)])


def _recorded(path: str | os.PathLike[str], view: View, network: ConstraintNetwork, about: str) -> Box:
    """What the certificate written to `path` proves of the network, whose only constraint is an array of rows."""
    network = _used(view, network)
    named = [("", view.contractor(network))]
    if not Contracting(named).gives_weights:
        raise ModelError("no certificate: the contractors give no weights; use lifted")
    domain = network.domain
    with Recording(network_statement(network, None, about), domain) as recording:
        never = LargestFirst(skip=domain.names)  # no box is divided: another pass while some width shrinks
        search = Search([domain], Divide(Contracting(named, recording.prover), never, again=_PAYS))
        for event in islice(search, _PASSES):
            recording.event(event)
        boxes = [node.box for node in search.pending] + [piece.box for piece in search.kept]
        left = boxes[0] if boxes else Box.empty(domain.names)
        hull = None if left.is_empty else limits(left)
        claims = {"cap": None, "infeasible": left.is_empty, "epsilon": None, "enclosure": hull, "point": None}
        recording.write(path, claims)
    return left
