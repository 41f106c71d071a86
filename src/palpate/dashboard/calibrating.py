"""Guided calibration on the page: rest, and newtons by a load cell or by dead weights."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from palpate.dashboard.job_context import CellBench, JobContext
from palpate.dashboard.messages import Calibrated
from palpate.dashboard.orders import CalibrateForce, CalibrateRest
from palpate.errors import DeviceError
from palpate.grasp.calibrating import HOLDS_N, Bench, measure_force, measure_rest
from palpate.grasp.planning import DWELL_S, HORIZON_S, with_force_law
from palpate.rig import Rig
from palpate.rig.sensor_only import SensorRig
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, Frame
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.sensor.dead_weights import checked_loads, weigh
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import rest_baseline

#: The rest values are the mean over this time.
_REST_S = 3.0


class _NoCell:
    """The load cell of a bench that needs none."""

    def read_n(self) -> float:
        """Raise `DeviceError`: there is none."""
        raise DeviceError("this rig has no load cell that palpate can read")


def calibrate_rest(order: CalibrateRest, *, context: JobContext) -> Calibrated:
    """Open the hand and take the rest values; refused when something presses or moves.

    Raises
    ------
    DeviceError
        If the sensor does not come to rest, or a pixel gives no signal.
    """
    rig = context.rig
    rest = _rest_alone(context) if isinstance(rig, SensorRig) else _rest_open(rig, context)
    before = rig.calibration
    if before is None:
        return _renewed(_begun(rig.array.layout, rest), file=order.file, context=context)
    # The date is what its age is judged by: that of the force readings, where there are any.
    made_at = before.made_at if before.force.force_n else _now()
    made = replace(before, rest=rest, made_at=made_at)
    return _renewed(made, file=order.file, context=context)


def _rest_open(rig: Rig, context: JobContext) -> RestValues:
    context.guide("The hand opens. Leave the sensor alone")
    bench = Bench(
        array=context.watched(),
        gripper=rig.gripper,
        cell=_NoCell(),
        clock=rig.clock,
        start=rig.gripper.limits.target(0.0),
    )
    return measure_rest(bench, duration_s=_REST_S)


def _rest_alone(context: JobContext) -> RestValues:
    """Take the rest values of a sensor that no hand holds."""
    context.guide("Leave the sensor alone")
    array, taken = context.watched(), list[Frame]()
    context.catch_up()
    while not taken or taken[-1].time_s - taken[0].time_s < _REST_S:
        taken.append(array.read(timeout_s=FRAME_TIMEOUT_S))
    ohm = pixel_resistance_ohm(
        np.array([frame.counts for frame in taken]),
        layout=array.layout,
        oversampling=taken[0].oversampling,
    )
    rest = rest_baseline(ohm)
    if not np.all(np.isfinite(rest.rest_ohm) & (rest.rest_ohm > 0)):
        raise DeviceError("a pixel is open or short: the doctor names it")
    return RestValues(
        ohm=tuple(map(tuple, rest.rest_ohm.tolist())),
        spread_percent=tuple(map(tuple, rest.spread_percent.tolist())),
        frames=rest.frames,
    )


def _begun(layout: ArrayLayout, rest: RestValues) -> Calibration:
    return Calibration(
        sensor_id=layout.name,
        origin="hardware",
        layout=layout,
        rest=rest,
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
        made_at=_now(),
    )


def calibrate_force(order: CalibrateForce, *, context: JobContext) -> Calibrated:
    """Pair readings with newtons and fit the law; the expected errors are part of the result.

    Raises
    ------
    InputError
        If the loads can't carry a calibration.
    CalibrationError
        If the readings can't.
    DeviceError
        If the rig has no load cell and no loads were given.
    """
    before = context.rig.calibration
    if before is None:
        raise DeviceError("the rest was not calibrated: take the rest values first")
    if order.loads_n:
        pairs = _weighed(checked_loads(order.loads_n, where="the loads"), context)
    elif context.open_bench is not None:
        pairs = _by_cell(context.open_bench(context.rig.name, context.seed), context)
    else:
        raise DeviceError("this rig has no load cell that palpate can read: give dead weights")
    made = with_force_law(replace(before, force=pairs))
    made = replace(made, made_at=_now())
    return _renewed(made, file=order.file, context=context)


def _by_cell(on: CellBench, context: JobContext) -> ForcePairs:
    """Close on a load cell, placement after placement; simulated, so as fast as it goes."""
    bench = replace(on.bench, array=context.watched(on.bench.array))

    def reseat(run: int) -> None:
        """Show which placement it is, and put the load cell between the fingers again."""
        share = run / len(HOLDS_N)
        text = f"Placing the load cell again: {run + 1} of {len(HOLDS_N)}"
        context.guide(text, share=share)
        on.reseat(run)

    return measure_force(
        bench, holds_n=HOLDS_N, reseat=reseat, dwell_s=DWELL_S, horizon_s=HORIZON_S
    )


def _weighed(loads_n: list[float], context: JobContext) -> ForcePairs:
    """Ask for one weight after the other; each is read once the user confirms it."""
    array, done = context.watched(), iter(range(len(loads_n)))

    def place(load_n: float) -> None:
        """Ask for a weight, and wait for the user to confirm that it lies there."""
        share = next(done) / len(loads_n)
        what = "Take every weight away"
        if load_n:
            what = f"Lay {load_n:g} N on the pad"
        context.confirmed.clear()
        context.guide(what, share=share, asks=True)
        while not context.confirmed.is_set():
            array.read(timeout_s=FRAME_TIMEOUT_S)
        settles = f"{load_n:g} N settles: leave it alone for 20 s"
        context.guide(settles, share=share)

    context.guide("Reading the rest values. Leave the sensor alone")
    return weigh(array, loads_n=loads_n, place=place, clock=context.rig.clock).pairs


def _renewed(made: Calibration, *, file: Path, context: JobContext) -> Calibrated:
    """Keep the calibration in its file, and work with it from now on."""
    before = context.rig.calibration
    before_ohm = made.rest_ohm if before is None else before.rest_ohm
    file.parent.mkdir(parents=True, exist_ok=True)
    made.save(file)
    context.rig = replace(context.rig, calibration=made)
    return Calibrated(
        file=file,
        rest_ohm=made.rest_ohm,
        change_percent=100.0 * (made.rest_ohm / before_ohm - 1.0),
        held_out=made.held_out.get("error_percent", {}),
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
