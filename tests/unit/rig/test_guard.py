"""The force guard, and rigs made of Python objects."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from examples.own_gripper import MySensor, Plates, my_calibration

import palpate
from palpate.calibration import ForcePairs
from palpate.clock import ManualClock, RealClock
from palpate.errors import CalibrationError, DeviceError
from palpate.rig import Rig

TIMEOUT_S = 20.0
pytestmark = pytest.mark.slow


class Rack:
    """The plates as an object with `width_mm`, `move` and `stop`."""

    lowest_mm, highest_mm, fastest_mm_s = 5.0, 74.0, 60.0

    def __init__(self, plates: Plates) -> None:
        self.plates, self.stops, self.is_deaf = plates, 0, False

    @property
    def width_mm(self) -> float:
        return self.plates.width_mm

    def move(self, width_mm: float, speed_mm_s: float) -> None:
        self.plates.move(width_mm, rate=speed_mm_s)

    def stop(self) -> None:
        self.stops += 1
        if self.is_deaf:
            raise OSError("no answer")
        self.plates.move(self.plates.width_mm, rate=1.0)


class Sensor(MySensor):
    """The toy sensor; it can be unplugged, or lose a pixel."""

    is_unplugged = is_saturated = False

    def read(self, *, timeout_s: float) -> Any:
        frame = super().read(timeout_s=timeout_s)
        if self.is_unplugged:
            raise DeviceError("the sensor is gone; check its cable")
        return replace(frame, counts=frame.counts * 0 + 1023) if self.is_saturated else frame


@pytest.fixture
def rack() -> Rack:
    return Rack(Plates(RealClock(), size_mm=40.0, n_per_mm=2.0))


@pytest.fixture
def rig(rack: Rack) -> Iterator[Rig]:
    sensor = Sensor(rack.plates, period_s=0.004)
    with palpate.open_rig(array=sensor, gripper=rack, calibration=my_calibration()) as opened:
        yield opened


def close_on_the_spring(rack: Rack) -> None:
    rack.plates.move(41.0, rate=1000.0)
    time.sleep(0.1)
    rack.move(30.0, 4.0)


def test_guard_stops_a_plain_object_before_the_true_force_passes_the_limit(
    rig: Rig, rack: Rack
) -> None:
    with palpate.ForceGuard(rig, limit_n=3.0) as guard:
        assert not guard.is_tripped
        close_on_the_spring(rack)
        assert guard.wait(TIMEOUT_S)
        assert "the limit of 3 N" in guard.reason
        assert 0.5 < rack.plates.force_n < 3.3
        held = rack.plates.force_n
        time.sleep(0.2)
        assert rack.plates.force_n == held
        # The hand can be opened, and is guarded again on request.
        rack.move(74.0, 60.0)
        time.sleep(0.7)
        assert rack.plates.force_n == 0.0
        guard.rearm()
        assert not guard.wait(0.1)
        close_on_the_spring(rack)
        assert guard.wait(TIMEOUT_S)
    assert rack.stops == 2


@pytest.mark.parametrize(
    ("fault", "reason"),
    [("is_unplugged", "check its cable"), ("is_saturated", "a pixel is at its limit")],
)
def test_guard_stops_the_gripper_when_the_sensor_fails(
    rig: Rig, rack: Rack, fault: str, reason: str
) -> None:
    with palpate.ForceGuard(rig, limit_n=3.0) as guard:
        guard.wait_for_reading(TIMEOUT_S)
        rack.move(60.0, 4.0)
        setattr(rig.array, fault, True)
        assert guard.wait(TIMEOUT_S)
        assert reason in guard.reason
    assert 60.0 < rack.width_mm < 74.0


def test_guard_of_a_gripper_that_does_not_stop_repeats_the_stop_and_raises(
    rig: Rig, rack: Rack
) -> None:
    rack.is_deaf = True
    guard = palpate.ForceGuard(rig, limit_n=3.0)
    guard.__enter__()
    close_on_the_spring(rack)
    assert guard.wait(TIMEOUT_S)
    time.sleep(0.1)
    with pytest.raises(DeviceError, match=r"and the stop failed: .*no answer"):
        guard.__exit__(None, None, None)
    assert rack.stops > 3


def test_guard_is_tripped_before_it_stops_so_that_no_command_follows(rig: Rig, rack: Rack) -> None:
    seen = list[bool]()

    class Watched:
        def stop(self) -> None:
            seen.append(guard.is_tripped)
            rack.stop()

    with palpate.ForceGuard(rig, limit_n=3.0, gripper=Watched()) as guard:
        close_on_the_spring(rack)
        assert guard.wait(TIMEOUT_S)
    assert seen == [True]


def test_guard_of_another_object_needs_no_gripper_in_the_rig(rack: Rack) -> None:
    sensor = Sensor(rack.plates, period_s=0.004)
    with palpate.open_rig(array=sensor, calibration=my_calibration()) as rig:
        with pytest.raises(palpate.InputError, match="no gripper"):
            palpate.ForceGuard(rig, limit_n=3.0)
        with pytest.raises(palpate.InputError, match="no gripper"):
            rig.grasp()
        with palpate.ForceGuard(rig, limit_n=3.0, gripper=rack) as guard:
            close_on_the_spring(rack)
            assert guard.wait(TIMEOUT_S)
    assert rack.plates.force_n < 3.3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"limit_n": 0.0}, "limit_n 0: must be above 0"),
        ({"limit_n": 3.0, "stale_s": -1.0}, "stale_s"),
        ({"limit_n": 3.0, "certainty": 1.0}, "certainty 1"),
    ],
)
def test_guard_refuses_numbers_out_of_range(
    rig: Rig, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(palpate.InputError, match=message):
        palpate.ForceGuard(rig, **options)


def test_guard_without_a_force_law_is_refused(rack: Rack) -> None:
    nothing = ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=())
    without = replace(my_calibration(), force=nothing)
    rig = palpate.open_rig(array=Sensor(rack.plates), gripper=rack, calibration=without)
    with pytest.raises(palpate.InputError, match="palpate calibrate force"):
        palpate.ForceGuard(rig, limit_n=3.0)


def test_objects_grasp_like_a_rig_file() -> None:
    clock = ManualClock()
    rack = Rack(Plates(clock, size_mm=40.0, n_per_mm=2.0))
    sensor = MySensor(rack.plates)
    opened = palpate.open_rig(array=sensor, gripper=rack, calibration=my_calibration())
    with replace(opened, clock=clock, gripper=with_clock(rack, clock)) as rig:
        result = rig.grasp(target_force_n=4.0).release()
    assert result.outcome == "held"
    assert result.size_mm is not None
    assert result.size_mm.low < 40.0 < result.size_mm.high


def with_clock(rack: Rack, clock: ManualClock) -> Any:
    from palpate.gripper.plain import PlainGripper

    return PlainGripper(rack, clock=clock)


def test_objects_that_do_not_fit_are_refused(rack: Rack, tmp_path: Path) -> None:
    calibration = my_calibration()
    sensor = MySensor(rack.plates)
    with pytest.raises(palpate.InputError, match="needs calibration=FILE"):
        palpate.open_rig(array=sensor, gripper=rack)
    with pytest.raises(palpate.InputError, match="belongs to array"):
        palpate.open_rig("sim-rigid", calibration=calibration)
    with pytest.raises(palpate.InputError, match="has its own gripper"):
        palpate.open_rig("sim-rigid", gripper=rack)
    with pytest.raises(palpate.InputError, match="object has no width_mm"):
        palpate.open_rig(array=sensor, gripper=object(), calibration=calibration)  # type: ignore[arg-type]
    sensor.layout = replace(sensor.layout, rows=1, finger_of_row=(0,))
    with pytest.raises(CalibrationError, match="another sensor"):
        palpate.open_rig(array=sensor, gripper=rack, calibration=calibration)
    calibration.save(tmp_path / "calibration.json")
    file = tmp_path / "rig.toml"
    file.write_text('use = "sim-rigid"\n')
    with pytest.raises(palpate.InputError, match="omit gripper"):
        palpate.open_rig(str(file), gripper=rack)


def weights_calibration(loads_n: list[float]) -> Any:
    """Return the toy calibration with dead weights instead of a load cell."""
    pixels = 8
    excess = [2.0 * load for load in loads_n]
    pairs = ForcePairs(
        run=tuple(range(len(loads_n))),
        since_move_s=(20.0,) * len(loads_n),
        excess=tuple(excess),
        relative_percent=tuple(-100.0 * one / (8.0 + one) for one in excess),
        force_n=tuple(loads_n),
        pixel_excess=tuple((one / pixels,) * pixels for one in excess),
    )
    return replace(my_calibration(), force=pairs, force_law={})


def test_guard_says_where_it_stops_and_the_true_force_is_there(rack: Rack) -> None:
    for calibration in (my_calibration(), weights_calibration([1.5, 4.0, 9.0])):
        sensor = Sensor(rack.plates, period_s=0.004)
        with palpate.open_rig(array=sensor, gripper=rack, calibration=calibration) as rig:
            with palpate.ForceGuard(rig, limit_n=3.0) as guard:
                said = re.search(r"at 3 N stops at about ([\d.]+) N", repr(guard))
                assert said is not None
                close_on_the_spring(rack)
                assert guard.wait(TIMEOUT_S)
                assert repr(guard) == f"ForceGuard({guard.reason})"
                # Weights tell too little of the toy's sheet for more.
                assert rack.plates.force_n == pytest.approx(float(said[1]), rel=0.4)
            rack.move(74.0, 200.0)
            time.sleep(0.7)


def test_guard_of_less_certainty_stops_nearer_to_its_limit_and_says_so(rack: Rack) -> None:
    stopped_n, said_n = list[float](), list[float]()
    for certainty in (0.95, 0.7, 0.5):
        sensor, calibration = Sensor(rack.plates, period_s=0.004), weights_calibration([1.5, 4.0])
        with palpate.open_rig(array=sensor, gripper=rack, calibration=calibration) as rig:
            with palpate.ForceGuard(rig, limit_n=3.0, certainty=certainty) as guard:
                said = re.search(r"at 3 N stops at about ([\d.]+) N", repr(guard))
                assert said is not None
                close_on_the_spring(rack)
                assert guard.wait(TIMEOUT_S)
                assert guard.reading is not None
                assert isinstance(guard.reading.force_n, palpate.Measurement)
                said_n.append(float(said[1]))
                stopped_n.append(guard.reading.force_n.middle)
            rack.move(74.0, 200.0)
            time.sleep(0.7)
    assert stopped_n == sorted(stopped_n)
    assert said_n == sorted(said_n)
    assert 3.0 < stopped_n[-1] < 3.3
    assert stopped_n[0] < 0.8 * stopped_n[-1]


def test_guard_that_stops_far_below_its_limit_warns_with_a_remedy(
    rack: Rack, caplog: pytest.LogCaptureFixture
) -> None:
    sensor = Sensor(rack.plates, period_s=0.004)
    contradictory = weights_calibration([1.5, 4.0, 9.0])
    pairs = replace(contradictory.force, excess=(6.0, 6.5, 20.0), pixel_excess=())
    rig = palpate.open_rig(
        array=sensor, gripper=rack, calibration=replace(contradictory, force=pairs)
    )
    with palpate.ForceGuard(rig, limit_n=3.0):
        pass
    assert "three more weights" in caplog.text
    with palpate.ForceGuard(rig, limit_n=0.05) as guard:
        assert guard.wait(TIMEOUT_S)
    assert "stops at once" in caplog.text
