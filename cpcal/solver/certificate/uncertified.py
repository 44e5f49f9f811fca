"""A certificate that cannot be written costs the certificate, not the answer."""

from __future__ import annotations

import os
from dataclasses import replace

from cpcal.common.errors import InputError
from cpcal.solver.certificate.recording import Claims, Recording
from cpcal.solver.optimize import Minimum


class UncertifiedError(InputError):
    """The certificate could not be written, or would be refused for its size; `answer` is what was found."""

    answer: Minimum


def certified(recording: Recording, path: str | os.PathLike[str], claims: Claims, found: Minimum) -> Minimum:
    """What was found, once its certificate is written. Raises UncertifiedError."""
    try:
        recording.write(path, claims)
    except InputError as error:
        raised = UncertifiedError(error.problems)
        raised.answer = found
        raise raised from None
    return replace(found, contractors_used=recording.credited(found.contractors_used))
