"""Saturated, open and unreadable pixels through every place that converts frames to force."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from packages.station.tests.dashboard.test_live import SOURCE
from packages.station.tests.dashboard.test_live import frames as page_frames
from tests.factories import WEIGHTS, make_sheet_law

from palpate.calibration import BlockPairs, Calibration, RestValues
from palpate.cli.live_reading import LiveReading
from palpate.cli.sensor_source import SensorSource
from palpate.clock import ManualClock
from palpate.force.force_follower import ForceFollower, ForceSource
from palpate.force.force_law import ForceLaw
from palpate.force.sheet_follower import SheetFollower
from palpate.measurement import Measurement, Status
from palpate.rig.reading import Reader
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.sensor.sample import pixel_resistance_ohm
from palpate.twin.devices import TwinArray
from palpate.twin.world import World
from palpate_foxglove.channels import encode_force
from palpate_station.dashboard.live import Live

#: Readings of a pressed sheet, and with one pixel saturated or open.
PRESSED, REST = np.full((4, 2), 600), np.full((4, 2), 300)
SATURATED, OPEN = PRESSED.copy(), PRESSED.copy()
SATURATED[1, 0], OPEN[1, 0] = 1023, 0
REST_OHM = pixel_resistance_ohm(REST, layout=RIGID_LAYOUT)


def weights_law() -> ForceLaw:
    return ForceLaw.fit(WEIGHTS.excess, force_n=WEIGHTS.force_n)


def make_follower() -> ForceFollower:
    return ForceFollower(weights_law())


def make_sheet_follower() -> SheetFollower:
    return SheetFollower(make_sheet_law(8))


def make_small_sheet_follower() -> SheetFollower:
    return SheetFollower(make_sheet_law(4))


def calibration() -> Calibration:
    def rows(values: np.ndarray) -> tuple[tuple[float, ...], ...]:
        return tuple(map(tuple, values.tolist()))

    spread = rows(np.full((4, 2), 0.1))
    return Calibration(
        sensor_id="pad",
        layout=RIGID_LAYOUT,
        rest=RestValues(ohm=rows(REST_OHM), spread_percent=spread, frames=20),
        force=WEIGHTS,
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
        origin="hardware",
    )


#: Converts counts at successive times, with rest values, to forces, as one of the consumers does.
Consumer = Callable[[Sequence[np.ndarray], np.ndarray], list[Measurement | None]]


def read_by_rig(counts: Sequence[np.ndarray], rest_ohm: np.ndarray) -> list[Measurement | None]:
    reader = Reader(calibration())
    reader.rest_ohm = rest_ohm
    return [reader.read(frame).force_n for frame in as_frames(counts)]


def make_live(rest_ohm: np.ndarray) -> LiveReading:
    source = SensorSource(name="bench", array=TwinArray(World(None, seed=1)), simulated=False)
    return LiveReading(source, rest_ohm=rest_ohm, clock=ManualClock(), force=make_sheet_follower())


def read_live(counts: Sequence[np.ndarray], rest_ohm: np.ndarray) -> list[Measurement | None]:
    live, found = make_live(rest_ohm), []
    for frame in as_frames(counts):
        live.add(frame)
        found.append(live.force_n)
    return found


def read_page(counts: Sequence[np.ndarray], rest_ohm: np.ndarray) -> list[Measurement | None]:
    live = Live()
    live.open_source(replace(SOURCE, law=make_sheet_law(8), rest_ohm=rest_ohm))
    for number, one in enumerate(counts):
        made = page_frames(1, from_s=0.1 * number, rate_hz=10.0, counts=300)
        live.add_frames(replace(made, counts=one[None], reported=np.full(1, 40.0)))
    return [point.force for point in live.curve]


def as_frames(counts: Sequence[np.ndarray]) -> list[Frame]:
    return [Frame(time_s=0.1 * n, sequence=n, counts=one) for n, one in enumerate(counts)]


@pytest.mark.parametrize("consumer", [read_by_rig, read_live, read_page])
@pytest.mark.parametrize("bad", [SATURATED, OPEN, np.full((4, 2), 0), np.full((4, 2), 1023)])
def test_force_of_bad_frame_says_so_and_next_good_frame_is_right(
    consumer: Consumer, bad: np.ndarray
) -> None:
    good = [REST] * 3 + [PRESSED] * 5
    *_, during, after = consumer([*good, bad, PRESSED], REST_OHM)
    *_, alone = consumer([*good, PRESSED, PRESSED], REST_OHM)
    assert after.value == pytest.approx(alone.value, rel=0.02)
    assert after.low == pytest.approx(alone.low, rel=0.05)
    if (bad == 1023).any() or bad is OPEN:
        # The load on an open pixel is unknown as well.
        assert during is not None
        assert during.status is Status.AT_LEAST
        assert 0 < during.low <= during.high < math.inf
    else:
        assert during is None or during.status is Status.NOT_MEASURED


@pytest.mark.parametrize("make", [make_follower, make_small_sheet_follower])
@pytest.mark.parametrize("bad", [math.inf, math.nan])
def test_force_source_without_layout_keeps_no_bad_pixel(
    make: Callable[[], ForceSource], bad: float
) -> None:
    good, source, other = np.full((2, 2), 3.0), make(), make()
    broken = good.copy()
    broken[0, 0] = bad
    for time_s in (0.0, 0.1, 0.2):
        source.step(time_s, good)
        other.step(time_s, good)
    during = source.step(0.3, broken)
    assert np.isfinite([during.low, during.high]).all()
    assert (during.status is Status.AT_LEAST) == math.isinf(bad)
    nothing = source.step(0.4, np.full((2, 2), bad))
    assert nothing.status is (Status.AT_LEAST if math.isinf(bad) else Status.NOT_MEASURED)
    if math.isnan(bad):
        other.step(0.3, broken)
        assert source.step(0.5, good).value == pytest.approx(other.step(0.5, good).value, rel=0.02)


def test_foxglove_message_of_a_bound_has_no_null() -> None:
    bound = Measurement(value=None, low=2.0, high=9.0, unit="n", status=Status.AT_LEAST)
    message = json.loads(encode_force(0.5, bound))
    assert (message["status"], message["low_n"]) == ("at_least", 2.0)
    assert not {"high_n", "force_n"} & set(message)
