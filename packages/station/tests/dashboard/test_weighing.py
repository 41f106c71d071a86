"""Calibration with dead weights, each confirmed by the user, and rest calibration."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from palpate.calibrate.rest import replace_rest
from palpate.calibration import Calibration, RestValues
from palpate.clock import ManualClock
from palpate.errors import DeviceError, InputError
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.rig import Rig
from palpate.rig.sensor_only import SensorRig
from palpate.sensor.array import RIGID_LAYOUT, Frame, PressureArray
from palpate_station.dashboard.jobs import (
    JobContext,
    StoppedByUserError,
    calibrate_force,
    calibrate_rest,
)
from palpate_station.dashboard.messages import CalibrateForce, CalibrateRest, Guide, Update
from palpate_station.dashboard.telemetry import Telemetry

LOADS = (0.5, 1.0, 2.0, 4.0, 2.0, 1.0)
REST_OHM = 9000.0


class PadAndUser:
    """A sheet with a power law and, with `creep`, a slow part, and a user who follows the guide."""

    layout = RIGID_LAYOUT
    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.load_n, self.sequence, self.seen = 0.0, 0, list[str]()
        self.context: JobContext | None = None
        self.gives_up_at = ""
        self.late_s = 0.0
        self.creep = self.lays_after_s = self.confirms_after_s = self.laid_s = 0.0
        self._next_n, self._confirm_at_s = 0.0, np.inf

    def read(self, *, timeout_s: float) -> Frame:
        self._obey()
        self.clock.sleep_s(0.1)
        excess = 0.0 if self.load_n == 0 else 8.0 * self.load_n**1.2
        excess *= 1.0 - self.creep * float(np.exp((self.laid_s - self.clock.now_s()) / 3.0))
        ohm = REST_OHM / (1.0 + excess / RIGID_LAYOUT.pixels)
        counts = 64 * 1024 / (1.0 + ohm / RIGID_LAYOUT.divider.reference_ohm)
        self.sequence += 1
        return Frame(
            time_s=self.clock.now_s() - self.late_s,
            sequence=self.sequence,
            counts=np.full((4, 2), round(counts), dtype=np.int32),
            oversampling=64,
        )

    def _obey(self) -> None:
        for note in notes_of(self.context.telemetry):
            self.seen.append(note.text)
            if self.gives_up_at and self.gives_up_at in note.text:
                self.context.requests.stop.set()
            if note.needs_confirmation:
                self._next_n = float(note.text.removeprefix("Place ").removesuffix(" N on the pad"))
                self.laid_s = self.clock.now_s() + self.lays_after_s
                self._confirm_at_s = self.laid_s + self.confirms_after_s
        if self.clock.now_s() >= self.laid_s:
            self.load_n = self._next_n
        if self.clock.now_s() >= self._confirm_at_s:
            self._confirm_at_s = np.inf
            self.context.confirmed.set()

    def state(self) -> GripperState:
        return GripperState(time_s=self.clock.now_s(), width_mm=74.0)

    def close(self) -> None:
        return


def notes_of(telemetry: Telemetry) -> list[Guide]:
    """Return the guides in the telemetry's next update."""
    update: Update = telemetry.update()
    return [note for note in update.notes if isinstance(note, Guide)]


@pytest.fixture
def pad() -> PadAndUser:
    pad = PadAndUser()
    rest = RestValues(ohm=((REST_OHM,) * 2,) * 4, spread_percent=((0.1,) * 2,) * 4, frames=9)
    calibration = replace_rest(None, rest, layout=RIGID_LAYOUT, simulated=False)
    devices: Any = pad
    pad.context = JobContext(
        rig=Rig(
            name="pad.toml",
            array=devices,
            gripper=devices,
            clock=pad.clock,
            calibration=calibration,
        ),
        array=devices,
        seed=0,
        telemetry=Telemetry(lambda update: None, on_lost=lambda: None),
        on_stopped=lambda: None,
        confirmed=threading.Event(),
    )
    return pad


def test_calibrate_force_with_weights_requests_every_load_and_recovers_the_law(
    pad: PadAndUser, tmp_path: Path
) -> None:
    order = CalibrateForce(file=tmp_path / "calibration.json", loads_n=LOADS)
    made = calibrate_force(order, context=pad.context)
    asked = [float(text.split()[1]) for text in pad.seen if text.startswith("Place ")]
    assert asked == list(LOADS)
    saved = Calibration.load(order.file)
    assert saved.force.force_n == LOADS
    assert pad.context.rig.calibration.force == saved.force
    errors = [error for error in made.held_out.values() if error is not None]
    assert errors
    # Without an end weight, the law extrapolates.
    assert max(errors) < 15.0


def test_calibrate_force_keeps_the_frames_from_before_the_confirmation(
    pad: PadAndUser, tmp_path: Path
) -> None:
    pad.creep, pad.lays_after_s, pad.confirms_after_s = 0.3, 1.0, 4.0
    order = CalibrateForce(file=tmp_path / "calibration.json", loads_n=(1.0, 4.0, 9.0))
    calibrate_force(order, context=pad.context)
    # This user exchanges the weights, so that the pad is empty before the first one only.
    assert Calibration.load(order.file).force.since_move_s == (2.0, 20.0, 20.0, 20.0)


def test_calibrate_force_stopped_between_weights_leaves_the_file_unchanged(
    pad: PadAndUser, tmp_path: Path
) -> None:
    before = pad.context.rig.calibration
    pad.gives_up_at = "Place 2 N"
    order = CalibrateForce(file=tmp_path / "calibration.json", loads_n=LOADS)
    with pytest.raises(StoppedByUserError, match="stopped on request"):
        calibrate_force(order, context=pad.context)
    assert pad.context.rig.calibration is before
    assert not order.file.exists()


def test_calibrate_force_without_load_cell_and_weights_is_refused(
    pad: PadAndUser, tmp_path: Path
) -> None:
    order = CalibrateForce(file=tmp_path / "calibration.json")
    with pytest.raises(DeviceError, match="use dead weights"):
        calibrate_force(order, context=pad.context)
    with pytest.raises(InputError, match="if the loads are in grams"):
        calibrate_force(replace(order, loads_n=(50.0, 100.0, 200.0, 400.0)), context=pad.context)


def test_calibrate_rest_without_gripper_and_file_creates_a_calibration(
    pad: PadAndUser, tmp_path: Path
) -> None:
    context, devices = pad.context, cast("PressureArray", pad)
    context.rig = SensorRig(name="pad.toml", array=devices, clock=pad.clock, calibration=None)
    measure_loads = CalibrateForce(file=tmp_path / "calibration.json", loads_n=LOADS)
    with pytest.raises(DeviceError, match="no rest values"):
        calibrate_force(measure_loads, context=context)
    assert context.source().rest_ohm is None
    made = calibrate_rest(CalibrateRest(file=measure_loads.file), context=context)
    assert made.rest_ohm == pytest.approx(np.full((4, 2), REST_OHM), rel=1e-3)
    assert np.array_equal(made.change_percent, np.zeros((4, 2)))
    calibrate_force(measure_loads, context=context)
    saved = Calibration.load(measure_loads.file)
    assert saved.force.force_n == LOADS
    assert saved.rest_ohm == pytest.approx(made.rest_ohm)
    context.stop_hand()
    assert context.reacted_s is not None
