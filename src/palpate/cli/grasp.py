"""`palpate grasp`: close on an unknown object and report its properties."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import options as option
from palpate.cli.options import (
    CutoffOption,
    EpsilonOption,
    ExtraOption,
    MethodOption,
    StepOption,
    opt,
    paper_settings,
)
from palpate.cli.output import print_json, print_message, tolerate_lost_output
from palpate.errors import InputError, RecordingLostError
from palpate.stop_signals import handle_always, handle_stop_signals

#: Exit statuses: 0 held, 1 negative answer, 3 equipment failure, 130 stopped by the user.
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
    from palpate.cli.grasp_extras import open_limit, open_store_entry, run_watched
    from palpate.grasp.document import grasp_document
    from palpate.grasp.paper_method import use_paper_method
    from palpate.grasp.planning import plan_grasp
    from palpate.grasp.pull import judge_pull
    from palpate.grasp.requests import Requests
    from palpate.grasp.verdict import outcome_text
    from palpate.rig import open_rig
    from palpate.rig.file import find_ports, replace_calibration
    from palpate.sensor.usb_latency import explain_latencies

    paper = paper_settings(
        method,
        step_mm=step_mm,
        epsilon_percent=epsilon_percent,
        extra_mm=extra_mm,
        cutoff_s=cutoff_s,
    )
    if paper is not None and (target_force_n is not None or expect_size_mm is not None):
        raise InputError("--method paper can't be combined with --target-force-n or --expect-size")
    if (pull_n is None) != (friction is None):
        raise InputError("--pull-n and --friction must be given together")
    limit = open_limit(damage, kind=kind)
    with ExitStack() as stack:
        entry = open_store_entry(stack, item_id=item, store=store, angle_deg=angle_deg)
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
        plan = plan_grasp(
            devices.calibration,
            gripper=devices.gripper,
            target_force_n=target_force_n,
            expect_size_mm=expect_size_mm,
            damage=None if limit is None else limit.model,
            kind="" if limit is None else limit.kind,
        )
        if paper is not None:
            plan = use_paper_method(plan, paper, calibration=devices.calibration)
        recording = stack.enter_context(ExitStack())
        result = run_watched(
            plan,
            rig=devices,
            limit=limit,
            entry=entry,
            record=record,
            requests=requests,
            stack=recording,
        )
        truth = None if devices.truth is None else dict(devices.truth())
        limited = None if limit is None else limit.to_dict(result)
        stored_names = (
            {} if entry is None else entry.add_result(result, rig=devices, recording=record)
        )
        pull = None
        if pull_n is not None and friction is not None:
            pull = judge_pull(result.force_n, pull_n=pull_n, friction=friction)
        with tolerate_lost_output():
            if as_json:
                document = grasp_document(
                    result,
                    target_force_n=target_force_n,
                    damage_limit=limited,
                    names=stored_names,
                    simulated=devices.is_simulated,
                    truth=truth,
                    subject=devices.subject,
                )
                if entry is not None:
                    document["item"] = entry.item_document()
                if pull is not None:
                    document["pull"] = pull.to_dict()
                print_json(document)
            else:
                print_card(
                    result,
                    target_force_n=target_force_n,
                    title=f"[bold]{devices.subject or 'unknown object'}[/] on {devices.name}",
                    simulated=devices.is_simulated,
                    seed=seed,
                    truth=truth,
                    limited=limited,
                )
                if pull is not None:
                    print(
                        f"{pull.verdict}: a pull of {pull.pull_n:g} N at friction {pull.friction:g}"
                    )
        # Stored after the result is printed, because the store may be slow or unreachable.
        is_lost = entry is not None and not entry.store()
        try:
            recording.close()
        except RecordingLostError as error:
            print_message(f"palpate grasp: {error}")
            is_lost = True
    status = EXIT_STATUS[result.outcome]
    if status >= 3:
        parts = (outcome_text(result.outcome), *result.faults)
        print_message(f"palpate grasp: {'. '.join(part.rstrip('.') for part in parts)}")
    if is_lost:
        status = _EXIT_NOT_STORED
    if status:
        raise typer.Exit(status)
