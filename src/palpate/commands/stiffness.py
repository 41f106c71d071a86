"""`palpate stiffness`: one object's stiffness from a series of grasps, firmer each time."""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from palpate.estimate.measurement import Measurement
    from palpate.grasp.series import Series, SeriesGrasp
    from palpate.rig import Rig


def stiffness(
    up_to_n: Annotated[
        float, typer.Option(help="Grip force of the firmest grasp: the object must bear it.")
    ],
    rig: Annotated[
        str, typer.Option(help="Name of a rig, or a rig file.", metavar="NAME_OR_TOML")
    ] = "sim-rigid",
    object_name: Annotated[
        str | None,
        typer.Option("--object", help="Simulated rigs: what to grasp; drawn by default."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Simulated rigs: decides what chance does.", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Grasp one object five times, firmer each time, and tell its stiffness from all of them.

    Nearer than one grasp, because settled forces at several widths tell the shape of the object's
    law. The hand opens for 20 s between grasps: two minutes and a half in all.

    Example: palpate stiffness --up-to-n 8 --object springs-4 --seed 3
    """
    from palpate.grasp.planning import plan_grasp
    from palpate.grasp.safety import FORCE_CEILING_N
    from palpate.grasp.series import run_series
    from palpate.rig import open_rig

    if not 0 < up_to_n <= FORCE_CEILING_N:
        raise InputError(
            f"--up-to-n {up_to_n:g}: must be above 0 and at most {FORCE_CEILING_N:g} N, the force "
            "ceiling"
        )
    with ExitStack() as stack:
        devices = open_rig(rig, object_name=object_name, seed=seed)
        stack.callback(devices.close)
        plan = plan_grasp(devices.calibration, gripper=devices.gripper)
        if plan.give is None:
            raise InputError(
                f"{rig}: fingers driven by pressure tell no width, and a series none of their "
                "stiffness; `palpate grasp` says what one grasp of theirs tells"
            )
        if not as_json:
            print(_heading(devices, seed=seed), flush=True)
        series = run_series(
            plan,
            up_to_n=up_to_n,
            array=devices.array,
            gripper=devices.gripper,
            clock=devices.clock,
            told=None if as_json else _print_grasp,
        )
        truth = None if devices.truth is None else dict(devices.truth())
    if as_json:
        print(json.dumps(_document(series, rig=devices, truth=truth), allow_nan=False, indent=1))
    else:
        _print_answer(series, truth=truth)
    _leave(series)


def _leave(series: Series) -> None:
    """Exit with what the series came to, and say why if it was not all that was asked for."""
    from palpate.commands.grasp import EXIT_STATUS
    from palpate.grasp.result import Outcome
    from palpate.grasp.verdict import outcome_text

    last = series.grasps[-1].result
    if last.outcome is not Outcome.HELD:
        why = f"{outcome_text(last.outcome)}. {' '.join(last.faults)}".strip()
        print(f"palpate stiffness: grasp {len(series.grasps)}: {why}", file=sys.stderr)
        raise typer.Exit(EXIT_STATUS[last.outcome])
    if series.stiffness_n_per_mm is None:
        print(
            f"palpate stiffness: {len(series.held)} grasps held, of too few forces for a curve; "
            "ask for a firmer one with --up-to-n",
            file=sys.stderr,
        )
        raise typer.Exit(1)


def _heading(rig: Rig, *, seed: int) -> str:
    where = f"SIMULATED on the twin, seed {seed}" if rig.simulated else "measured"
    return (
        f"{rig.subject or 'unknown object'} on {rig.name}, {where}\n"
        "  target   force, N            stiffness by that grasp alone, N/mm"
    )


def _print_grasp(one: SeriesGrasp) -> None:
    force, stiffness = one.result.force_n, one.result.stiffness_n_per_mm
    cells = ["-" if found is None else _interval(found) for found in (force, stiffness)]
    ended = "" if one.result.outcome == "held" else f"  {one.result.outcome}"
    print(f"  {one.target_force_n:4.1f} N   {cells[0]:20}{cells[1]}{ended}", flush=True)


def _interval(found: Measurement) -> str:
    return f"{found.value:.2f} ({found.low:.2f} … {found.high:.2f})"


def _print_answer(series: Series, *, truth: Mapping[str, object] | None) -> None:
    found, at = series.stiffness_n_per_mm, series.firmest_force_n
    if found is None or at is None:
        return
    print(f"Stiffness {_interval(found)} N/mm at {at.value:.1f} N (90 % interval)")
    if truth is not None:
        true, damaged = truth["stiffness_n_per_mm"], truth["damaged"]
        print(f"  true (twin, last grasp): {true:.2f} N/mm")
        if damaged:
            print("  The object was damaged: its force passed the yield.")


def _document(series: Series, *, rig: Rig, truth: Mapping[str, object] | None) -> dict[str, object]:
    found, at = series.stiffness_n_per_mm, series.firmest_force_n
    document: dict[str, object] = {
        "stiffness_n_per_mm": None if found is None else found.as_json(),
        "at_force_n": None if at is None else at.as_json(),
        "grasps_held": len(series.held),
        "grasps": [
            {
                "target_force_n": one.target_force_n,
                "opening_mm": one.opening_mm,
                **one.result.as_json(),
            }
            for one in series.grasps
        ],
    }
    if truth is not None:
        document |= {"simulated": True, "object": rig.subject, "truth": truth}
    return document
