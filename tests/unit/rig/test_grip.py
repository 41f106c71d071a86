"""Use of a rig in a script: reading, grasping, holding and release."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.calibration import Calibration
from palpate.recording import load_recording
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

pytestmark = pytest.mark.slow

SEED = 4


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return palpate.open_rig("sim-rigid", object_name="tomato", seed=SEED).calibration


@pytest.fixture
def rig(calibration: Calibration) -> palpate.Rig:
    return make_rig(calibration, name="tomato")


def make_rig(calibration: Calibration, *, name: str | None) -> palpate.Rig:
    """Return a rig at the rate of the paper's board, with an object or none."""
    subject = None if name is None else draw_object(np.random.default_rng(SEED), name)
    world = World(subject, seed=SEED, sheet_seed=SEED, frame_rate_hz=15.0)
    return palpate.Rig(
        name="twin",
        array=TwinArray(world),
        gripper=TwinGripper(world),
        clock=world.clock,
        calibration=calibration,
        origin="twin",
        subject=name,
        seed=SEED,
    )


def test_grasp_holds_and_is_recorded_until_released(rig: palpate.Rig, tmp_path: Path) -> None:
    file = tmp_path / "grasp.mcap"
    with rig:
        grip = rig.grasp(target_force_n=2.0, record=file)
        assert grip.is_holding
        assert grip.outcome is palpate.Outcome.HELD
        reading = rig.read()
        assert reading.contact
        assert reading.force_n.low < 2.0 < reading.force_n.high
        assert grip.size_mm is not None
        document = grip.to_dict()
        result = grip.release()
        assert not grip.is_holding
        assert result.outcome is palpate.Outcome.HELD
        assert rig.gripper.state().width_mm == pytest.approx(rig.gripper.limits.highest, abs=0.5)
        assert grip.release() is result
    recording = load_recording(file)
    assert recording.info.target_force_n == 2.0
    assert recording.info.seed == SEED
    assert recording.time_s.size == result.frames
    assert json.loads(json.dumps(document, allow_nan=False))["outcome"] == "held"
    assert document["simulated"] is True


def test_grasp_second_grasp_is_refused_and_block_end_releases(rig: palpate.Rig) -> None:
    with rig:
        grip = rig.grasp()
        with pytest.raises(palpate.InputError, match="release it first"):
            rig.grasp()
    assert not grip.is_holding
    assert grip.outcome is palpate.Outcome.HELD


def test_rig_error_in_block_stops_without_dropping_object(rig: palpate.Rig) -> None:
    grips: list[palpate.Grip] = []

    def grasp_and_fail() -> None:
        with rig:
            grips.append(rig.grasp())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        grasp_and_fail()
    assert grips[0].outcome is palpate.Outcome.STOPPED
    width = rig.gripper.state().width_mm
    assert width < rig.gripper.limits.highest - 10.0


@pytest.fixture(scope="module")
def idle(calibration: Calibration) -> Iterator[palpate.Rig]:
    """Yield a rig whose gripper has not moved."""
    with make_rig(calibration, name="tomato") as rig:
        yield rig


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target_force_n": -1.0}, "target_force_n -1: must be at least 0.15 N"),
        ({"kind": "kiwi"}, "requires damage=FILE, which defines the kinds"),
        ({"method": "paper", "cutoff_s": 0.1}, "cutoff_s must be from 0.8 to 60, not 0.1"),
        ({"method": "paper", "target_force_n": 3.0}, "neither a target force nor"),
    ],
)
def test_grasp_invalid_options_are_refused(
    options: dict[str, float], message: str, idle: palpate.Rig
) -> None:
    before_s = idle.read().time_s
    with pytest.raises(palpate.InputError, match=message):
        idle.grasp(**options)  # type: ignore[arg-type]
    # No frame was read in between.
    assert idle.read().time_s - before_s == pytest.approx(1 / 15)


@pytest.mark.parametrize(("rate_hz", "period_s"), [(None, 0.004), (15.0, 1 / 15)])
def test_open_rig_simulated_reads_at_the_rate_of_the_firmware_or_the_given_one(
    rate_hz: float | None, period_s: float
) -> None:
    wanted = {"object_name": "tomato", "seed": SEED, "rate_hz": rate_hz}
    with palpate.open_rig("sim-rigid", **wanted) as rig:
        first, second = (rig.array.read(timeout_s=1.0).time_s for _ in range(2))
    assert second - first == pytest.approx(period_s)


@pytest.mark.parametrize(
    ("name", "rate_hz", "message"),
    [("mujoco", 15.0, "for sim-rigid, sim-soft, sim-firmware only"), ("sim-rigid", 0.0, "0 Hz")],
)
def test_open_rig_refuses_a_rate_it_cannot_set(name: str, rate_hz: float, message: str) -> None:
    with pytest.raises(palpate.InputError, match=message):
        palpate.open_rig(name, rate_hz=rate_hz)
