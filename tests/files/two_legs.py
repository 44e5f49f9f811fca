"""A small good campaign as text, for tests to spoil."""

import os

import pytest

from cpcal.common.errors import InputError
from cpcal.files import load_campaign

TOML = """\
format = "cpcal-campaign/1"
[robot]
name = "two legs"
base = [
    [0.0, 0.0, 0.0],
    [1.0, 2.0, 3.0],
]
mobile = [[0, 0, 0], [1, 0, 0]]
offset = [5.0, 6.0]

[uncertainty]
factor = 3.0
position_sigma = [0.1, 0.1, 0.1]
rotation_sigma = [1e-4, 1e-4, 1e-4]
length_sigma = [0.01, 0.02]

[provenance]
where = "here"
"""
UNCERTAINTY = TOML[TOML.index("[uncertainty]") : TOML.index("[provenance]")]
CSV = """\
pose,run,x,y,z,qw,qx,qy,qz,L1,L2
a,1,1,2,3,1,0,0,0,10,11
a,2,1,2,3,0,1,0,0,10,11
b,1,1,2,3,0.6,0.8,0,0,10,11
"""


def load(folder, toml=TOML, table=CSV):
    for name, content in (("campaign.toml", toml), ("measurements.csv", table)):
        if content is not None:
            (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_campaign(folder)


def refused(folder, toml=TOML, table=CSV):
    """(file, line, what, remedy) of every problem."""
    with pytest.raises(InputError) as caught:
        load(folder, toml, table)
    for problem in caught.value.problems:
        assert problem.remedy
        assert len(str(problem)) < 500 + len(str(folder))
    return [(os.path.basename(p.where), p.line, p.what, p.remedy) for p in caught.value.problems]
