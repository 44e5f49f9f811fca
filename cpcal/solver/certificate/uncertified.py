"""A certificate that cannot be written costs the certificate, not the answer."""

from __future__ import annotations

from cpcal.common.errors import InputError
from cpcal.solver.optimize import Minimum


class UncertifiedError(InputError):
    """The certificate could not be written, or would be refused for its size; `answer` is what was found."""

    answer: Minimum

    @classmethod
    def after(cls, answer: Minimum, error: InputError) -> UncertifiedError:
        made = cls(error.problems)
        made.answer = answer
        return made
