"""Inject single faults of sheet, wire, servo and host in every phase of a grasp."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from palpate.grasp.safety import FORCE_CEILING_N
from palpate_studies.fault_devices import FAULTS
from palpate_studies.fault_grasps import (
    KINDS,
    OBJECTS,
    RATES_HZ,
    FaultyGrasp,
    list_cells,
    run_faulty_grasp,
    sample_cells,
)
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import as_row, group

#: Seeds of the sample and of the first object; neither was used to develop the monitors.
_SAMPLE_SEED, _FIRST_SEED = 43, 920_000
#: Forces below this count as zero, newtons.
_NOTHING_N = 0.05
#: Outcomes that need no reason: requested ones, and events in the world.
_SELF_EXPLANATORY = ("held", "slipped", "nothing_there", "too_weak", "stopped")


def report(
    *,
    sample: Annotated[
        int,
        typer.Option("--sample", help="Number of grasps, evenly over the faults; 0: all.", min=0),
    ] = 200,
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate-hz", help="Frames/s of the sensor, 15 or 250; default: both."),
    ] = None,
) -> StudyReport:
    """Apply single faults to simulated grasps; report force, outcome and time to safety.

    Example: palpate study faults --sample 400 --out reports
    """
    rates_hz = RATES_HZ if rate_hz is None else (rate_hz,)
    cells = list_cells(rates_hz=rates_hz)
    chosen = sample_cells(cells, sample, seed=_SAMPLE_SEED) if sample else cells
    return judge([run_faulty_grasp(cell, seed=_FIRST_SEED + k) for k, cell in enumerate(chosen)])


command = as_command(report)


def judge(found: Sequence[FaultyGrasp]) -> StudyReport:
    """Return the report of any number of grasps, with a row per fault and hand."""
    struck_grasps = [one for one in found if one.struck]
    return StudyReport(
        name="faults",
        title="Single faults in a grasp",
        provenance=[
            f"Simulated, level lab: {len(found)} of {len(list_cells())} grasps of "
            f"{', '.join(OBJECTS)} at half, full and twice the speed, with faults at the start of "
            "a phase or in the middle of a movement, at 15 and 250 frames/s. Each grasp has a new "
            "object and session; all share one sheet and gripper per kind of fingers.",
            f"The force ceiling is {FORCE_CEILING_N:g} N. Forces are the twin's true forces. Rigid "
            "fingers report current, soft fingers pressure.",
        ],
        tables=[
            _table(
                "Worst case of the faults of each part",
                {"fault of": "{part}", "fingers": "{kind}"},
                [
                    {"part": part, "kind": kind, **_worst(each)}
                    for kind in KINDS
                    for part in dict.fromkeys(make().part for make in FAULTS.values())
                    if (
                        each := [
                            one
                            for one in struck_grasps
                            if (FAULTS[one.cell.fault]().part, one.cell.kind) == (part, kind)
                        ]
                    )
                ],
            ),
            *(
                _table(
                    f"{key['kind']} fingers: worst case of each fault",
                    {"fault": "{fault}"},
                    [fault | _worst(each) for fault, each in group(mine, "cell.fault")],
                )
                for key, mine in group(struck_grasps, "cell.kind")
            ),
        ],
        payload={
            "study": "faults",
            "origin": "twin",
            "ceiling_n": FORCE_CEILING_N,
            "grasps": [{**row.pop("cell"), **row} for row in map(as_row, found)],
        },
    )


def is_unexplained(one: FaultyGrasp) -> bool:
    """Return whether a grasp ended unexpectedly without a reason."""
    return not one.reason and one.outcome not in _SELF_EXPLANATORY


def _worst(struck_grasps: Sequence[FaultyGrasp]) -> dict[str, Any]:
    """Return the worst case of the grasps in which a fault occurred."""
    berries = [one for one in struck_grasps if one.cell.thing == "strawberry"]
    stays_n = max(one.stays_n for one in struck_grasps)
    outcomes = Counter(one.outcome for one in struck_grasps)
    return {
        "n": len(struck_grasps),
        "outcomes": ", ".join(f"{name} {outcomes[name]}" for name in sorted(outcomes)),
        "peak_n": max(one.peak_n for one in struck_grasps),
        "stays_n": stays_n if stays_n > _NOTHING_N else 0.0,
        "crushed": sum(one.damaged for one in berries),
        "berries": len(berries),
        "unexplained": sum(map(is_unexplained, struck_grasps)),
        "safe_s": max(one.safe_s for one in struck_grasps),
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
            "largest remaining force, N": "{stays_n:.1f}",
            "strawberries crushed": "{crushed} of {berries}",
            "no reason given": "{unexplained}",
            "safe within, s": "{safe_s:.1f}",
        },
    )
