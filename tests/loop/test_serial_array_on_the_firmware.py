"""The serial array with the firmware: set-up, refusals and resets."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.clock import ManualClock
from palpate.errors import WireError
from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout, Frame, PressureArray
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import BoardStatus, Contents, SetPressure
from palpate.twin.devices import TwinArray
from palpate.twin.firmware import FirmwareBoard, FirmwareStream, open_firmware_array
from palpate.twin.objects import draw_object
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")


class Rig:
    """The twin's pixels on a simulated board, and the host on its serial line."""

    def __init__(
        self,
        *,
        layout: ArrayLayout = RIGID_LAYOUT,
        rate_hz: float = 250.0,
        oversampling: int = 1,
        contents: Contents = Contents.PIXELS,
    ) -> None:
        self.clock = ManualClock(50.0)
        world = World(None, seed=3, clock=self.clock, layout=layout)
        self.board = FirmwareBoard(seed=1)
        self.array = SerialArray(
            FirmwareStream(world, board=self.board),
            clock=self.clock,
            layout=layout,
            rate_hz=rate_hz,
            oversampling=oversampling,
            contents=contents,
        )

    def frames(self, duration_s: float) -> list[Frame]:
        end_s, frames = self.clock.now_s() + duration_s, list[Frame]()
        while self.clock.now_s() < end_s:
            frames.append(self.array.read(timeout_s=2.0))
        return frames


@pytest.fixture
def open_board_rig() -> Iterator[Callable[..., Rig]]:
    """Open a rig that is closed after the test."""
    with ExitStack() as closing:

        def open_board_rig(**options: Any) -> Rig:
            rig = Rig(**options)
            closing.callback(rig.array.close)
            return rig

        yield open_board_rig


@pytest.mark.parametrize(
    ("layout", "rate_hz", "oversampling"), [(RIGID_LAYOUT, 500.0, 1), (SOFT_LAYOUT, 50.0, 8)]
)
def test_serial_array_configures_the_board_as_requested(
    layout: ArrayLayout, rate_hz: float, oversampling: int, open_board_rig: Callable[..., Rig]
) -> None:
    rig = open_board_rig(layout=layout, rate_hz=rate_hz, oversampling=oversampling)
    identity = rig.array.identity
    assert (identity.board, identity.rate_hz) == ("Arduino Mega 2560", rate_hz)
    assert (identity.rows, identity.cols) == (layout.rows, layout.cols)
    frames = rig.frames(0.5)
    assert [frame.sequence for frame in frames] == list(range(len(frames)))
    assert len(frames) == pytest.approx(0.5 * rate_hz, abs=2)
    assert {frame.oversampling for frame in frames} == {oversampling}
    assert frames[-1].counts.max() > 100 * oversampling
    # The host time of a scan is before its arrival by at most two polls and the transmission time.
    age_s = rig.clock.now_s() - frames[-1].time_s
    assert 0 < age_s < 0.004 + oversampling * layout.pixels * 115e-6
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(1 / rate_hz, abs=1.1e-3)
    counters = rig.array.counters
    assert (counters.lost, counters.corrupt, counters.late, counters.restarts) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("layout", "rate_hz", "oversampling"),
    [(RIGID_LAYOUT, 250.0, 64), (SOFT_LAYOUT, 700.0, 1)],
)
def test_serial_array_refuses_an_impossible_rate_with_the_highest_possible_rate(
    layout: ArrayLayout, rate_hz: float, oversampling: int, open_board_rig: Callable[..., Rig]
) -> None:
    with pytest.raises(
        WireError, match=rf"does not support {rate_hz:g} frames/s .*; at most"
    ) as refused:
        Rig(layout=layout, rate_hz=rate_hz, oversampling=oversampling)
    found = re.search(r"at most ([\d.]+)$", str(refused.value))
    highest_hz = float(found[1])
    assert highest_hz < rate_hz
    with pytest.raises(WireError, match="at most"):
        Rig(layout=layout, rate_hz=1.01 * highest_hz, oversampling=oversampling)
    rig = open_board_rig(layout=layout, rate_hz=0.999 * highest_hz, oversampling=oversampling)
    assert len(rig.frames(0.4)) == pytest.approx(0.4 * highest_hz, rel=0.02, abs=1)
    assert rig.array.counters.lost == 0


def test_serial_array_recovers_after_a_watchdog_reset(open_board_rig: Callable[..., Rig]) -> None:
    rig = open_board_rig(contents=Contents.PRESSURE)
    before = rig.frames(0.2)
    rig.array.send(SetPressure(target_kpa=20.0, slew_kpa_per_s=500.0))
    before += rig.frames(0.1)
    assert rig.board.output_kpa == pytest.approx(20.0, abs=0.1)
    rig.board.hang()
    after = rig.frames(0.8)
    identity = rig.array.identity
    assert identity.reset_cause & 8, "watchdog"
    assert rig.array.counters.restarts == 1
    assert rig.board.output_kpa == 0, "no pressure was requested after the reset"
    assert rig.array.read_newest().status & BoardStatus.WATCHDOG_RESET
    _assert_one_gap(before + after, longest_s=0.45)


def _settled_counts(seed: int, *, firmware: bool) -> NDArray[np.float64]:
    """Return the mean counts of each pixel, at rest and under a held object."""
    obj = draw_object(np.random.default_rng(seed), "ball-44lbs")
    world = World(obj, seed=seed, clock=ManualClock(5.0), frame_rate_hz=100.0)
    array: PressureArray = TwinArray(world)
    if firmware:
        array = open_firmware_array(world, noise_mv=1e3 * 5.0 / 1024 * 0.4, rate_hz=100.0)
    found = []
    for width_mm in (70.0, 0.9 * obj.size_mm):
        world.drive(width_mm, rate=60.0)
        frames = [array.read(timeout_s=1.0) for _ in range(200)]
        found.append(np.mean([frame.counts for frame in frames[100:]], axis=0))
    array.close()
    return np.array(found)


def test_serial_array_counts_match_the_twin_readout_within_the_noise() -> None:
    offsets = []
    for seed in range(3):
        twin, board = (_settled_counts(seed, firmware=through) for through in (False, True))
        # Slow noise and residual settling of the sheet differ between seeds.
        assert np.abs(board - twin).max() < 1.0 + 0.004 * twin.max()
        offsets.append(board - twin)
    # A converter that truncates instead of rounding has an error of half a count.
    assert abs(float(np.median(offsets))) < 0.2


def _assert_one_gap(frames: list[Frame], *, longest_s: float) -> None:
    """Check that sequence and time advance regularly, with one gap."""
    assert np.all(np.diff([frame.sequence for frame in frames]) >= 1)
    steps_s = np.sort(np.diff([frame.time_s for frame in frames]))
    assert 0.01 < steps_s[-1] < longest_s
    assert steps_s[:-1] == pytest.approx(0.004, abs=2.5e-3)
