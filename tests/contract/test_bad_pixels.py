"""Saturated, open and missing pixels in everything that uses frames.

One contract: no infinite or missing number, a saturated pixel never lowers the load, the other
pixels still count while a pixel is open or missing, and the next good frame reads as without the
bad one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.unit.grasp.conftest import plan as _plan_fixture
from tests.whole.test_pixel_excess import make_live, read_by_rig, read_live, read_page

from palpate.calibrate.dead_weights import measure_loads
from palpate.clock import ManualClock
from palpate.errors import CalibrationError
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.plan import Plan
from palpate.gripper.interface import GripperState
from palpate.measurement import Measurement, Status
from palpate.recording import RecordingInfo, RecordingWriter, load_recording
from palpate.recording.exporting import cut_recorded_holds
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, Frame
from palpate.sensor.sample import SampleReader, pixel_resistance_ohm
from palpate_foxglove.channels import encode_change

plan = _plan_fixture
REST, PRESSED = np.full((4, 2), 300), np.full((4, 2), 600)
PIXEL = (1, 0)
#: Counts of the pixel in the bad frame. A missing pixel has no signal in any frame.
FAULTS = {"saturated": 1023, "open": 0, "missing": 0}
#: Loads of successive frames, in the unit of the consumer; None if it reports none.
Loads = list[float | None]
#: Converts counts at successive times, with rest values, as one of the consumers does.
Consumer = Callable[[Sequence[np.ndarray], np.ndarray], Loads]


def as_frames(counts: Sequence[np.ndarray]) -> list[Frame]:
    return [Frame(time_s=0.1 * at, sequence=at, counts=one) for at, one in enumerate(counts)]


def load_of(force: Measurement | None) -> float | None:
    if force is None or force.status is Status.NOT_MEASURED:
        return None
    assert math.isfinite(force.low)
    assert math.isfinite(force.high)
    return force.middle


def loads_of(
    read: Callable[[Sequence[np.ndarray], np.ndarray], list[Measurement | None]],
) -> Consumer:
    return lambda counts, rest_ohm: [load_of(force) for force in read(counts, rest_ohm)]


def read_in_grasp(plan: Plan) -> Consumer:
    def read(counts: Sequence[np.ndarray], rest_ohm: np.ndarray) -> Loads:
        estimate = ContactEstimate(rest_ohm=rest_ohm, sent=24.0, still_since_s=0.0, contact_s=0.0)
        for frame in as_frames(counts):
            state = GripperState(time_s=frame.time_s, width_mm=50.0, moving=False)
            estimate.update(Observation(frame=frame, gripper=state), plan=plan)
        assert np.isfinite([touch.strongest_percent for touch in estimate.touches]).all()
        return [touch.sheet_n for touch in estimate.touches]

    return read


def send_to_foxglove(counts: Sequence[np.ndarray], rest_ohm: np.ndarray) -> Loads:
    live, found = make_live(rest_ohm), list[float | None]()
    for frame in as_frames(counts):
        live.add(frame)
        assert live.change_percent is not None
        message = json.loads(encode_change(frame.time_s, live.change_percent, layout=RIGID_LAYOUT))
        found.append(-message["mean_percent"])
    return found


def export(folder: Path) -> Consumer:
    def cut(counts: Sequence[np.ndarray], _rest_ohm: np.ndarray) -> Loads:
        """Record a rest, a movement and a hold of the given frames; cut the hold."""
        rest, path = [counts[0]] * 20, folder / f"{len(list(folder.iterdir()))}.mcap"
        with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")) as out:
            # The last frame ends the hold, and is not part of it.
            held = [*[counts[-3]] * 10, *counts[-2:], counts[-1]]
            for frame in as_frames([*rest, *counts[3:-2], *held]):
                moves = 20 <= frame.sequence < 22
                width_mm = 60.0 if frame.sequence < 20 else 50.0
                out.add(GripperState(time_s=frame.time_s, width_mm=width_mm, moving=moves))
                out.add(frame)
        mean = cut_recorded_holds(load_recording(path))[0]
        assert mean.channel == "mean"
        return [-value for value in mean.values.tolist()]

    return cut


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("consumer", ["rig", "live", "page", "grasp", "foxglove", "export"])
def test_bad_pixel_neither_hides_nor_invents_a_load(
    consumer: str, fault: str, plan: Plan, tmp_path: Path
) -> None:
    read = {
        "rig": loads_of(read_by_rig),
        "live": loads_of(read_live),
        "page": loads_of(read_page),
        "grasp": read_in_grasp(plan),
        "foxglove": send_to_foxglove,
        "export": export(tmp_path),
    }[consumer]
    rest, pressed, bad = REST.copy(), PRESSED.copy(), PRESSED.copy()
    bad[PIXEL] = FAULTS[fault]
    rest_ohm = pixel_resistance_ohm(rest, layout=RIGID_LAYOUT)
    if fault == "missing":
        rest[PIXEL] = pressed[PIXEL] = 0
        rest_ohm = np.where(rest == 0, np.nan, rest_ohm)
    good = [rest] * 3 + [pressed] * 5
    *_, during, after = read([*good, bad, pressed], rest_ohm)
    *_, alone = read([*good, pressed, pressed], rest_ohm)
    assert alone is not None
    assert after == pytest.approx(alone, rel=0.02)
    assert during is not None
    assert math.isfinite(during)
    if fault == "saturated":
        assert during >= 0.98 * alone
    else:
        assert during == pytest.approx(alone, rel=0.4)


class Weighing:
    """A sheet with weights; `spoil` changes the counts of its frames."""

    layout: ArrayLayout = RIGID_LAYOUT

    def __init__(self, spoil: Callable[[int, np.ndarray], np.ndarray]) -> None:
        self.clock, self._spoil, self._sequence, self._counts = ManualClock(), spoil, 0, REST

    def place(self, load_n: float) -> None:
        self._counts = np.full((4, 2), 300 + round(90 * math.log1p(3 * load_n)))

    def read(self, *, timeout_s: float) -> Frame:
        del timeout_s
        self.clock.sleep_s(0.1)
        self._sequence += 1
        counts = self._spoil(self._sequence, self._counts.copy())
        return Frame(time_s=self.clock.now_s(), sequence=self._sequence, counts=counts)

    def close(self) -> None:
        pass


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("lasting", [False, True])
def test_dead_weights_with_a_bad_pixel_are_refused_or_right(fault: str, lasting: bool) -> None:
    def spoil(sequence: int, counts: np.ndarray) -> np.ndarray:
        loaded = counts.max() > 300
        if fault == "missing" or (loaded and (lasting or sequence % 97 == 0)):
            counts[PIXEL] = FAULTS[fault]
        return counts

    def measure(sheet: Weighing) -> list[float]:
        found = measure_loads(sheet, loads_n=[1.5, 4.0, 9.0], place=sheet.place, clock=sheet.clock)
        return list(found.pairs.excess)

    if lasting and fault != "missing":
        with pytest.raises(CalibrationError, match=r"saturated|no reading"):
            measure(Weighing(spoil))
        return
    sound = measure(Weighing(lambda _, counts: counts))
    share = 7 / 8 if fault == "missing" else 1.0
    assert measure(Weighing(spoil)) == pytest.approx([share * one for one in sound], rel=0.02)


def test_sample_names_each_bad_pixel_once() -> None:
    counts = np.array([[300, 1023], [0, 0], [600, 600], [600, 600]])
    rest_ohm = np.full((4, 2), 1e4)
    rest_ohm[1, 1] = rest_ohm[2, 0] = np.nan
    rest_ohm[3, 0] = np.inf
    sample = SampleReader(RIGID_LAYOUT, rest_ohm).read(as_frames([counts])[0])
    assert np.argwhere(sample.saturated).tolist() == [[0, 1]]
    assert np.argwhere(sample.open).tolist() == [[1, 0]]
    assert np.argwhere(sample.missing).tolist() == [[1, 1], [2, 0], [3, 0]]
    known = ~(sample.open | sample.missing)
    assert (np.isfinite(sample.excess) == known).all()
    with pytest.raises(ValueError, match="read-only"):
        sample.excess[0, 0] = 0.0


def test_sample_age_is_unknown_without_a_present_time() -> None:
    frame = Frame(time_s=2.0, sequence=1, counts=REST)
    reader = SampleReader(RIGID_LAYOUT)
    assert reader.read(frame).age_s is None
    assert reader.read(frame, now_s=2.5).age_s == 0.5
    assert reader.read(frame, now_s=1.9).age_s == 0.0
