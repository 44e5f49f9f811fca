"""What a run of `certify` keeps on disk while it works, so that another one can go on from there.

Two files a leg, in the folder `checkpoint` of the run: `legN.answer` once the leg is answered, with its certificates;
before that `legN.search`, where its branch and bound stands. Whoever works on the leg writes them.
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cpcal.common.errors import CpcalError
from cpcal.common.version import __version__
from cpcal.execution.checkpoint_file import garbled, kept, read_checkpoint
from cpcal.files import campaign_sha256
from cpcal.files.codec import decoded, encoded
from cpcal.legs import LegModel, built_in, leg_box, leg_network
from cpcal.results import LegResult, Options, Result
from cpcal.robot import Campaign
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.certificate.search_keeper import SearchKeeper
from cpcal.solver.interval import get_arithmetic

FOLDER = "checkpoint"
_LIMITS = {"legs": None, "time_limit": None, "node_limit": None, "tolerance": None}  # change no bracket
_LOGGER = logging.getLogger("cpcal")

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Checkpoints:
    """The folder, and what its files are of: they are refused for anything else. `resume`: what is there counts."""

    folder: Path
    of: Mapping[str, str]
    resume: bool = False

    @classmethod
    def for_run(cls, run: Path, campaign: Campaign, options: Options, model: LegModel, *, resume: bool) -> Checkpoints:
        """Those in the folder of a run. Limits may change between a run and the one that goes on with it."""
        asked = replace(options, **_LIMITS) if options.method == "bound" else options  # type: ignore[arg-type]
        text = json.dumps(encoded(asked), sort_keys=True)
        of = {
            "version": __version__,
            "campaign": campaign_sha256(campaign),
            "options": hashlib.sha256(text.encode()).hexdigest(),
            "model": _model_digest(campaign, model),
        }
        return cls(run / FOLDER, of, resume)

    def begin(self) -> None:
        """Forget what is there, unless it is to be resumed. Raises InputError when a file there is refused."""
        if not self.resume:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        for path in sorted(self.folder.glob("leg*")) if self.folder.is_dir() else []:
            read_checkpoint(path, self._of(path.name))

    def end_after(self, result: Result) -> None:
        """The result is in its place: what was kept goes, unless a stop or a limit left something to go on with."""
        if not result.interrupted and not any(self.folder.glob("*.search")):
            shutil.rmtree(self.folder, ignore_errors=True)

    def answer(self, leg: int) -> tuple[LegResult, dict[str, bytes]] | None:
        """The leg, if it is answered already, and its certificates. Raises InputError."""
        path = self._path(leg, "answer")
        if not (self.resume and path.exists()):
            return None
        first, *rest = read_checkpoint(path, self._of(path.name))
        try:
            files = {str(line["file"]): str(line["text"]).encode() for line in rest}
            return decoded(LegResult, first["leg"]), files
        except (KeyError, ValueError, CpcalError) as error:
            raise garbled(path, error) from None

    def keep_answer(self, leg: LegResult, files: Files) -> None:
        """The leg is answered: that is kept, and where its search stood no longer matters."""
        path = self._path(leg.leg, "answer")
        lines = [{"leg": encoded(leg)}, *({"file": name, "text": text.decode()} for name, text in files.items())]
        if kept(path, self._of(path.name), lines):
            self._path(leg.leg, "search").unlink(missing_ok=True)
            _LOGGER.info("kept", extra={"fields": {"leg": leg.leg, "eps_lo": leg.eps_lo, "eps_hi": leg.eps_hi}})

    def search_keeper(self, leg: int, recording: Recording | None) -> SearchKeeper:
        """What keeps where the search for a leg stands."""
        path = self._path(leg, "search")
        return SearchKeeper(path, self._of(path.name), recording, resume=self.resume)

    def _path(self, leg: int, kind: str) -> Path:
        return self.folder / f"leg{leg}.{kind}"

    def _of(self, name: str) -> dict[str, str]:
        return {**self.of, "part": name}


def _model_digest(campaign: Campaign, model: LegModel) -> str:
    """Of its name and parameters and, where it is a user's, of the equations that it makes of every leg: a function
    that was edited between two runs keeps its name."""
    text = json.dumps(encoded((model.name, model.summary, model.extra)), sort_keys=True)
    digest = hashlib.sha256(text.encode())
    if not built_in(model):
        box, engine = leg_box(np.zeros(len(model.parameters)), 0.0, model), get_arithmetic("float64")
        for leg in range(1, campaign.legs + 1):
            digest.update(leg_network(campaign, leg, box, engine=engine, model=model).digest.encode())
    return digest.hexdigest()
