"""`palpate grasp`: close on an unknown object and report its properties."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import options as option
from palpate.cli.lazy_group import find_entry_point
from palpate.cli.options import (
    CutoffOption,
    EpsilonOption,
    ExtraOption,
    MethodOption,
    StepOption,
    opt,
    paper_settings,
    refuse_options,
)
from palpate.cli.output import print_json, print_message, tolerate_lost_output
from palpate.errors import InputError
from palpate.grasp.safety import MOST_TIGHTENINGS
from palpate.stop_signals import handle_always, handle_stop_signals

#: Exit statuses: 0 held, 1 negative answer, 3 equipment failure, 130 stopped by the user. Names,
#: because `Outcome` would load NumPy and SciPy before the options are read.
EXIT_STATUS = {
    "held": 0,
    "nothing_there": 1,
    "slipped": 1,
    "too_weak": 1,
    "force_limit": 1,
    "timed_out": 1,
    "sensor_lost": 3,
    "gripper_fault": 3,
    "stopped": 130,
}
#: Exit status if writing to the local store or the recording failed.
_EXIT_NOT_STORED = 3


def grasp(
    rig: option.RigOption = "",
    object_name: option.ObjectOption = None,
    seed: option.SeedOption = 0,
    rate_hz: option.SimulatedRateOption = None,
    target_force_n: option.TargetForceOption = None,
    expect_size_mm: Annotated[
        float | None,
        opt(
            "--expect-size MM",
            "Approximate thickness of the object, for a faster approach.",
            min=1.0,
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        opt("--calibration FILE", "Use this calibration instead of the rig's."),
    ] = None,
    damage: option.DamageOption = None,
    kind: Annotated[
        str | None, opt("--kind NAME", "With --damage: kind of produce, if known.")
    ] = None,
    tighten: Annotated[
        int,
        opt(
            "--tighten TIMES",
            "Tighten the grip when the held object slips, at most so often; 0: never.",
            min=0,
            max=MOST_TIGHTENINGS,
        ),
    ] = 0,
    pull_n: Annotated[
        float | None,
        opt("--pull-n NEWTONS", "Check whether the grip withstands this pull.", min=0.01),
    ] = None,
    friction: Annotated[
        float | None,
        opt(
            "--friction NUMBER",
            "With --pull-n: friction coefficient between pads and object.",
            min=0.01,
        ),
    ] = None,
    method: MethodOption = "palpate",
    step_mm: StepOption = None,
    epsilon_percent: EpsilonOption = None,
    extra_mm: ExtraOption = None,
    cutoff_s: CutoffOption = None,
    as_json: option.JsonOption = False,
    record: Annotated[
        Path | None, opt("--record FILE", "Record the grasp to a new .mcap file.")
    ] = None,
    item: Annotated[
        str | None,
        opt(
            "--item ITEM",
            "Store the grasp with this item.",
            autocompletion=option.complete_items,
        ),
    ] = None,
    store: option.StoreOption = None,
    angle_deg: Annotated[
        float | None,
        opt(
            "--angle-deg DEGREES", "With --item: rotation of the item relative to the first finger."
        ),
    ] = None,
) -> None:
    """Close on an unknown object, measure size, force and stiffness, and release it.

    Example: palpate grasp --object strawberry --seed 3
    """
    # Imported here to keep help and completion fast.
    from palpate.cli.grasp_card import print_card
    from palpate.grasp.damage_limit import load_limit
    from palpate.grasp.pull import judge_pull
    from palpate.grasp.requests import Requests
    from palpate.grasp.verdict import outcome_text
    from palpate.rig import open_rig
    from palpate.rig.file import find_ports, replace_calibration
    from palpate.rig.job import GraspJob
    from palpate.sensor.usb_latency import explain_latencies

    paper = paper_settings(
        method,
        step_mm=step_mm,
        epsilon_percent=epsilon_percent,
        extra_mm=extra_mm,
        cutoff_s=cutoff_s,
    )
    if (pull_n is None) != (friction is None):
        raise InputError("--pull-n and --friction must be given together")
    limit = load_limit(damage, kind=kind, names={"damage": "--damage FILE", "kind": "--kind"})
    with ExitStack() as stack:
        entry = None
        if item is None:
            given = {"--store": store, "--angle-deg": angle_deg}
            refuse_options(given, why="name the item with --item NAME")
        else:
            package = ("palpate-station", "packages/station")
            opener = find_entry_point(option.ITEMS, "open", *package, wanted="--item").load()
            entry = stack.enter_context(opener(item, store=store, angle_deg=angle_deg))
        devices = open_rig(rig, object_name=object_name, seed=seed, rate_hz=rate_hz)
        requests = Requests()
        # Signals only set a flag until the devices are closed: after the grasp they must not
        # truncate the recording or the store.
        stack.enter_context(handle_stop_signals(handle_always(requests.stop.set)))
        if calibration is not None:
            devices = replace_calibration(devices, calibration)
        stack.callback(devices.close)
        for text in explain_latencies(find_ports(rig, array=devices.array)):
            print_message(f"palpate grasp: {text}")
        job = GraspJob(
            devices,
            target_force_n=target_force_n,
            expect_size_mm=expect_size_mm,
            tighten=tighten,
            limit=limit,
            paper=paper,
            record=record,
            requests=requests,
        )
        with job:
            job.run(
                subscribers=[] if entry is None else [entry.add_observation],
                watchers=[] if entry is None else [entry.watch(job.plan)],
            )
        document, result = job.document(), job.result
        if entry is not None:
            document = entry.add_document(document, rig=devices, recording=record)
        if pull_n is not None and friction is not None:
            pull = judge_pull(result.force_n, pull_n=pull_n, friction=friction)
            document = replace(document, pull=pull)
        with tolerate_lost_output():
            if as_json:
                print_json(document.to_dict())
            else:
                print_card(
                    document,
                    title=f"[bold]{devices.subject or 'unknown object'}[/] on {devices.name}",
                    seed=seed,
                )
        # Stored after the result is printed, because the store may be slow or unreachable.
        is_lost = entry is not None and not entry.store()
        if job.lost is not None:
            print_message(f"palpate grasp: {job.lost}")
            is_lost = True
    status = EXIT_STATUS[result.outcome]
    if status >= 3:
        parts = (outcome_text(result.outcome), *result.faults)
        print_message(f"palpate grasp: {'. '.join(part.rstrip('.') for part in parts)}")
    if is_lost:
        status = _EXIT_NOT_STORED
    if status:
        raise typer.Exit(status)
