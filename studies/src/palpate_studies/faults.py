"""Single faults of sheet, wire, servo and host in every phase of a grasp, and what they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any

import typer

from palpate.commands.options import JsonOption
from palpate.grasp.safety import FORCE_CEILING_N
from palpate_studies.fault_devices import FAULTS
from palpate_studies.fault_grasps import KINDS, OBJECTS, Cell, Struck, cells, sampled, struck
from palpate_studies.report import OutOption, StudyReport, Table

#: Which grasps are sampled, and the first object; seeds that the watches were not made with.
_SAMPLE_SEED, _FIRST_SEED = 43, 920_000
#: A hand that presses less than this presses nothing, newtons.
_NOTHING_N = 0.05
#: Ends that need no reason: what was asked for, or what the world did.
_PLAIN = ("held", "slipped", "nothing_there", "too_weak", "stopped")


def command(
    sample: Annotated[
        int, typer.Option("--sample", help="Grasps, every fault about as often; 0: all.", min=0)
    ] = 200,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Strike grasps on the twin with single faults: true force, what stays, outcome, time to safe.

    Example: palpate study faults --sample 400 --out reports
    """
    report(sampled(sample, seed=_SAMPLE_SEED) if sample else cells()).emit(as_json=as_json, out=out)


def report(chosen: Sequence[Cell], *, first_seed: int = _FIRST_SEED) -> StudyReport:
    """Run the grasps and report them."""
    return reported([struck(cell, seed=first_seed + i) for i, cell in enumerate(chosen)])


def reported(found: Sequence[Struck]) -> StudyReport:
    """Report grasps, a row for each fault and hand."""
    return StudyReport(
        name="faults",
        title="Single faults in a grasp",
        provenance=[
            f"Simulated, level lab: {len(found)} of {len(cells())} grasps of "
            f"{', '.join(OBJECTS)} at half, full and twice the speed, each with an object and a "
            "session of its own; one sheet and gripper of each kind.",
            f"The ceiling is {FORCE_CEILING_N:g} N. Forces are the twin's own. Rigid fingers "
            "report current, soft ones pressure.",
        ],
        tables=[_parts(found), *(_table(found, kind) for kind in KINDS)],
        payload={
            "study": "faults",
            "origin": "twin",
            "ceiling_n": FORCE_CEILING_N,
            "grasps": [_as_json(one) for one in found],
        },
    )


def unexplained(one: Struck) -> bool:
    """Whether a grasp ended otherwise than asked and gives no reason."""
    return not one.reason and one.outcome not in _PLAIN


def _as_json(one: Struck) -> dict[str, Any]:
    plain = asdict(one)
    return {**plain.pop("cell"), **plain, "safe_s": one.safe_s if one.struck else None}


def _parts(found: Sequence[Struck]) -> Table:
    """Return the worst of each part that fails, over everything else."""
    groups = dict[tuple[str, str], list[Struck]]()
    for one in found:
        if one.struck:
            groups.setdefault((FAULTS[one.cell.fault]().part, one.cell.kind), []).append(one)
    return Table(
        title="The worst of the faults of each part",
        columns=(
            *("fault of", "fingers", "n", "largest peak, N", "most that stays, N"),
            *("strawberries crushed", "no reason given"),
        ),
        rows=[(part, kind, *_worst(hit)) for (part, kind), hit in sorted(groups.items())],
    )


def _worst(hit: Sequence[Struck]) -> tuple[str, ...]:
    berries = [one for one in hit if one.cell.thing == "strawberry"]
    stays_n = max(one.stays_n for one in hit)
    return (
        str(len(hit)),
        f"{max(one.peak_n for one in hit):.1f}",
        f"{stays_n:.1f}" if stays_n > _NOTHING_N else "0",
        f"{sum(one.damaged for one in berries)} of {len(berries)}",
        str(sum(unexplained(one) for one in hit)),
    )


def _table(found: Sequence[Struck], kind: str) -> Table:
    rows = []
    for name in FAULTS:
        hit = [one for one in found if one.cell.fault == name and one.cell.kind == kind]
        hit = [one for one in hit if one.struck]
        if hit:
            rows.append(_row(name, hit))
    return Table(
        title=f"{kind} fingers: the worst of the grasps of each fault",
        columns=(
            "fault",
            "n",
            "outcomes",
            "peak, N",
            "stays, N",
            "crushed berries",
            "no reason",
            "safe within, s",
        ),
        rows=rows,
    )


def _row(name: str, hit: Sequence[Struck]) -> tuple[str, ...]:
    outcomes = {one.outcome: sum(o.outcome == one.outcome for o in hit) for one in hit}
    count, *worst = _worst(hit)
    counts = ", ".join(f"{outcome} {count}" for outcome, count in sorted(outcomes.items()))
    return (name, count, counts, *worst, f"{max(one.safe_s for one in hit):.1f}")
