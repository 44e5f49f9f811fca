"""`cpcal solve`: all solutions of a written problem, or its best value, proved. `cpcal plugins`: what is installed."""

from functools import partial
from pathlib import Path

from cpcal.cli.verbs import Status, Talk, Where, argument, check_writable, line, option, output
from cpcal.common.errors import ClashError, CpcalError, printable, refuse
from cpcal.common.files import write_file
from cpcal.common.numbers import about, nearest, stated
from cpcal.problems.problem import Answer, answer, load_problem, sol_bytes
from cpcal.solver import plugins as registry
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.execution.stopping import asked, heard

# ------------------------------------------------------------------------------------------------------------------
# `cpcal solve`: a problem that was written for another solver; all its solutions, or its best value, proved.

_SHOWN = 20  # solutions in the terminal


def solve(
    source: Path = argument("FILE", "A problem: Minibex (.bch, .mbx) or AMPL (.nl)."),
    file: Path = output("FILE", "The answer: .json, or .sol for AMPL."),
    width: float | None = option(None, "Of boxes not divided further; else 1e-6, coarser along curves.", "W"),
    gap: float = option(1e-6, "Of the objective's bracket, relative.", "G"),
    time_limit: float | None = option(None, "Seconds.", "S", min=0.0),
    node_limit: int | None = option(None, "Boxes.", "N", min=1),
    certificate: Path | None = option(None, "Of a minimisation: the proof, for cpcal verify.", "FILE"),
    *,
    where: Where,
    talk: Talk,
) -> Status:
    """All solutions of a system, each box proved to hold exactly one where that can be; or the smallest value.

    While it works OUTPUT.checkpoint says where it stands, and --resume goes on from there.
    """
    refuse((file.suffix not in (".json", ".sol"), str(file), "is neither a .json nor a .sol file", "name it so"))
    for path in (file, certificate):
        if path is not None:
            check_writable(path.absolute().parent)
    problem = load_problem(source)
    checkpoint = file.with_name(f"{file.name}.checkpoint")
    with heard(terminate=True), line(talk.console()) as shown:
        found = answer(
            problem,
            width=width,
            limits=Limits(seconds=time_limit, nodes=node_limit, gap=gap),
            certificate=certificate,
            checkpoint=checkpoint,
            resume=where.resume,
            workers=where.workers,
            scheduler=where.scheduler,
            searched=shown.searched,
            bracketed=partial(shown.bracketed, largest=problem.maximize),
        )
        reason = asked()
    try:
        rows = len(problem.network.constraints)
        write_file(file, sol_bytes(found, rows) if file.suffix == ".sol" else found.to_json())
    finally:  # a full disk costs the files, not the answer
        _show(found, file, talk)
    if checkpoint.exists():
        talk.say(f"--resume goes on from here, by {checkpoint}.")
    if found.uncertified is not None:
        raise found.uncertified
    if reason is not None and found.verdict is Verdict.UNKNOWN:
        return Status(reason)
    return Status.UNKNOWN if found.verdict in (Verdict.UNKNOWN, Verdict.NOT_CERTIFIED) else Status.ANSWERED


def _show(found: Answer, output: Path, talk: Talk) -> None:
    talk.say(str(found.status))
    solutions = () if found.paving is None else found.paving.solutions
    shown = len(solutions) if talk.verbose else _SHOWN
    for k, solution in enumerate(solutions[:shown]):
        word = "exactly one" if solution.verdict is Verdict.PROVED else "perhaps some"
        inside = ", ".join(f"{n} {about(solution.box[n].mid, 9)}" for n in found.problem.network.names)
        talk.say(f"  {k + 1:3}  {word:12}  {inside}")
    if len(solutions) > shown:
        talk.say(f"  and {len(solutions) - shown:,} more")
    if found.point is not None:
        talk.say("  at " + ", ".join(f"{name} = {about(value, 9)}" for name, value in found.point.items()))
    width = "" if found.paving is None else f"; boxes are divided down to {stated(found.paving.width)}"
    talk.say(f"Method: {found.method.rstrip('.')}{width}.")
    talk.say(f"{found.nodes:,} nodes, {nearest(found.seconds, 2)} s: {output}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal plugins`: what other packages, and this one, provide by entry point.


def plugins() -> None:
    """List the contractors, search strategies and leg models found, whose they are, and whether they load.

    With exit status 2 where two packages register the same name: nobody can use it.
    """
    from cpcal.models import leg_model  # here: a problem needs no model of a leg

    clashes, rows = [], []
    for group, what in registry.KINDS.items():
        for name, point in registry.found(group).items():
            package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
            loads = "yes"
            try:
                leg_model(name) if group == registry.LEG_GROUP else registry.load(name, group)
            except CpcalError as error:
                clashes += [error] if isinstance(error, ClashError) else []
                loads = str(error)
            rows.append([printable(cell) for cell in (name, what, point.value, package, loads)])
    talk = Talk()
    talk.table(("name", "what", "from", "package", "loads"), rows, left=range(5))
    talk.say(f"Found through the entry-point groups {', '.join(registry.KINDS)}.")
    if clashes:
        raise clashes[0]
