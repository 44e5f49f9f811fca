"""The command `cpcal`: thin verbs over the Python interface.

Exit statuses, the same for every verb:

    0    done; for `certify`, every leg is answered ("refuted" is an answer)
    1    some leg is unknown: a limit was reached first
    2    unusable input or options, or a full disk: one message on stderr lists every problem
    3    an internal error, which is a defect of cpcal: one sentence asks for a report
    130  interrupted by Ctrl-C; what was proved until then is written and printed
"""

from cpcal.cli.app import app

__all__ = ["app"]
