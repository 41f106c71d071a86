"""Single faults of sheet, wire, servo and host in every phase of a grasp."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from palpate.grasp.safety import FORCE_CEILING_N
from palpate_studies.fault_devices import FAULTS
from palpate_studies.fault_grasps import KINDS, OBJECTS, Struck, cells, sample_cells, struck
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import as_row, group

#: Which grasps are sampled, and the first object; seeds that the watches were not made with.
_SAMPLE_SEED, _FIRST_SEED = 43, 920_000
#: A hand that presses less than this presses nothing, newtons.
_NOTHING_N = 0.05
#: Ends that need no reason: what was asked for, or what the world did.
_PLAIN = ("held", "slipped", "nothing_there", "too_weak", "stopped")


def report(
    *,
    sample: Annotated[
        int, typer.Option("--sample", help="Grasps, every fault about as often; 0: all.", min=0)
    ] = 200,
) -> StudyReport:
    """Apply single faults to simulated grasps: true force, outcome, time to a safe state.

    Example: palpate study faults --sample 400 --out reports
    """
    chosen = sample_cells(sample, seed=_SAMPLE_SEED) if sample else cells()
    return judge([struck(cell, seed=_FIRST_SEED + k) for k, cell in enumerate(chosen)])


command = as_command(report)


def judge(found: Sequence[Struck]) -> StudyReport:
    """Report grasps, a row for each fault and hand."""
    hit = [one for one in found if one.struck]
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
        tables=[
            _table(
                "The worst of the faults of each part",
                {"fault of": "{part}", "fingers": "{kind}"},
                [
                    {"part": part, "kind": kind, **_worst(each)}
                    for kind in KINDS
                    for part in dict.fromkeys(make().part for make in FAULTS.values())
                    if (
                        each := [
                            one
                            for one in hit
                            if (FAULTS[one.cell.fault]().part, one.cell.kind) == (part, kind)
                        ]
                    )
                ],
            ),
            *(
                _table(
                    f"{key['kind']} fingers: the worst of the grasps of each fault",
                    {"fault": "{fault}"},
                    [fault | _worst(each) for fault, each in group(mine, "cell.fault")],
                )
                for key, mine in group(hit, "cell.kind")
            ),
        ],
        payload={
            "study": "faults",
            "origin": "twin",
            "ceiling_n": FORCE_CEILING_N,
            "grasps": [{**row.pop("cell"), **row} for row in map(as_row, found)],
        },
    )


def is_unexplained(one: Struck) -> bool:
    """Whether a grasp ended otherwise than asked and gives no reason."""
    return not one.reason and one.outcome not in _PLAIN


def _worst(hit: Sequence[Struck]) -> dict[str, Any]:
    """Return the worst of some grasps that a fault struck."""
    berries = [one for one in hit if one.cell.thing == "strawberry"]
    stays_n = max(one.stays_n for one in hit)
    outcomes = Counter(one.outcome for one in hit)
    return {
        "n": len(hit),
        "outcomes": ", ".join(f"{name} {outcomes[name]}" for name in sorted(outcomes)),
        "peak_n": max(one.peak_n for one in hit),
        "stays_n": stays_n if stays_n > _NOTHING_N else 0.0,
        "crushed": sum(one.damaged for one in berries),
        "berries": len(berries),
        "unexplained": sum(map(is_unexplained, hit)),
        "safe_s": max(one.safe_s for one in hit),
    }


def _table(title: str, lead: dict[str, str], rows: Sequence[dict[str, Any]]) -> Table:
    return Table.of(
        title,
        rows,
        {
            **lead,
            "n": "{n}",
            "outcomes": "{outcomes}",
            "largest peak, N": "{peak_n:.1f}",
            "most that stays, N": "{stays_n:.1f}",
            "strawberries crushed": "{crushed} of {berries}",
            "no reason given": "{unexplained}",
            "safe within, s": "{safe_s:.1f}",
        },
    )
