"""The stored record of a grasp: result, change of each pixel, calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

import numpy as np

from palpate.grasp.estimator import Observation
from palpate.grasp.result import GraspResult
from palpate.measurement import Measurement
from palpate.recording import Origin
from palpate.sensor.array import ArrayLayout
from palpate_station.answer_pixels import MEAN_S, answer_pixel_percent, answer_time_s
from palpate_station.records import MEASURED, Drive, Grasp
from palpate_station.ripeness.shared_load import measure_shared_pixels
from palpate_station.store.writing import calibration_id_of

#: Measurements of a result; the gripper measures width or pressure (`hold_measurements`).
_ANSWERED = ("settled_percent", "size_mm", "force_n", "stiffness_n_per_mm", "firmness")

#: Name of the gripper's own measurement for each kind of gripper.
_HOLD_NAMES: dict[Drive, str] = {"width": "width_mm", "pressure": "pressure_kpa"}


def make_grasp_record(
    result: GraspResult,
    *,
    item_id: str,
    observations: Sequence[Observation],
    layout: ArrayLayout,
    rig: str,
    drive: Drive,
    origin: Origin,
    calibration: str,
    recording: Path | None,
    angle_deg: float | None = None,
    station: str | None = None,
    closing: Mapping[str, Measurement] = MappingProxyType({}),
) -> Grasp:
    """Return the record of a grasp, with the present time.

    `observations`: every observation of the grasp.
    `calibration`: the complete text of the calibration file.
    `recording`: the file of the grasp's frames.
    `angle_deg`: side of the item at the first finger.
    `station`: name of the station.
    `closing`: measurements during closing (`ClosingWatch.list_measurements`).
    """
    measured = list_answers(result)
    measured |= {**hold_measurements(observations, result=result, drive=drive), **closing}
    return Grasp(
        item_id=item_id,
        taken_at=datetime.now(UTC),
        rig=rig,
        drive=drive,
        origin=origin,
        outcome=result.outcome,
        measurements=measured
        | measure_shared_pixels(observations, result=result, layout=layout, measured=measured),
        pixel_settled_percent=answer_pixel_percent(observations, result=result, layout=layout),
        decision_time_s=result.decision_time_s,
        peak_force_n=result.peak_force_n,
        firmness_force_n=result.firmness_force_n,
        angle_deg=angle_deg,
        station=station,
        calibration_id=calibration_id_of(calibration),
        recording=None if recording is None else str(recording.resolve()),
    )


def list_answers(result: GraspResult) -> dict[str, Measurement]:
    """Return the answers of a grasp, including bounds, by their names in the store."""
    found = ((name, getattr(result, name)) for name in _ANSWERED)
    return {name: value for name, value in found if value is not None}


def hold_measurements(
    observations: Sequence[Observation], *, result: GraspResult, drive: Drive
) -> dict[str, Measurement]:
    """Return width (mm) or pressure (kPa) at the answer, by name; empty without an answer.

    The value is the mean of the gripper's reports, with the gripper's own zero, over the averaging
    time of the pixels. The interval contains all reports. For one hand and one object, the position
    determines the force independently of the sheet.

    `drive` ("width" or "pressure"): kind of gripper.
    """
    name, until_s = _HOLD_NAMES[drive], answer_time_s(result)
    if until_s is None:
        return {}
    reported = [
        getattr(one.gripper, name)
        for one in observations
        if until_s - MEAN_S < one.frame.time_s <= until_s
    ]
    if not reported or not np.isfinite(reported).all():
        return {}
    low, high = min(reported), max(reported)
    # A mean of equal numbers may have a rounding error.
    value = min(max(float(np.mean(reported)), low), high)
    return {name: Measurement(value=value, low=low, high=high, unit=MEASURED[name])}
