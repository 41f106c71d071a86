"""Force after a calibration with dead weights: its errors, its intervals, and where a guard stops.

    python benchmarks/weights.py --sheets 60 --seed 9900000

Everything is simulated: sheets of the rigid fingers (15 frames/s), drawn anew from the seeds SEED,
SEED + 1, ... of each level. Each is calibrated as by `palpate calibrate force` (`measure_loads`,
`fit_sheet_law`) with weights on both pads: 1.5, 4 and 9 N, then 1, 2.5 and 6 N too. Each weight
lands on an empty, rested sheet within 0.15 to 0.6 s, and is typed 3 s later, so that its early
reading is recorded. Then come eight built-in objects, each with two new placements:

- a load of 0.5 to 10 N, reached within 0.3 to 2 s, and held for 20 s: median error, fraction of the
  90 % intervals that contain the force, and their median half-width, so long after the load was
  reached;
- a closing at 1 to 6 N/s that is guarded as by `ForceGuard`: the true force in the frame that stops
  it, median, 10 and 90 % quantiles, and fraction above the limit. A hand rises on while it stops.

The product is compared with itself without the early readings, and with a power law of the summed
settled readings (least squares in ln force). This has no interval: its guard stops where it reads
the limit. A sheet is refused if the product refuses its weights. Loads with a saturated pixel are
left out; a closing ends there.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.dead_weights import KeptFrames, measure_loads
from palpate.calibration import ForcePairs
from palpate.clock import ManualClock
from palpate.errors import CalibrationError
from palpate.force.of_calibration import fit_sheet_law, follow_force, settled_pairs
from palpate.force.sheet_law import SheetLaw
from palpate.rig.guard_limit import USUAL_CERTAINTY
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.sensor.sample import SampleReader
from palpate.signal.relative import total_excess
from palpate.twin.mechanics import pixel_fractions
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.placement import PixelGrid, Placements
from palpate.twin.ranges import ranges_of
from palpate.twin.readout import Readout
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import Environment, draw_sheet

LEVELS = ("lab", "field")
LOADS_N, COUNTS, OBJECTS_PER_SHEET = (1.5, 4.0, 9.0, 1.0, 2.5, 6.0), (3, 6), 8
AFTER_S, LIMIT_N = (0.4, 1.0, 3.0, 20.0), 3.0
METHODS = ("as it is", "without early readings", "power law")
FRAME_S = 1 / 15
#: Load, newtons, time to it, seconds, and rate of a closing, N/s: ranges, log-uniform.
DRAWN = np.array([(0.5, 10.0), (0.3, 2.0), (1.0, 6.0)])
#: Force at the end of a closing.
LARGEST_N = 12.0
#: Stiffness of a held object.
STIFFNESS_N_PER_MM = 3.0
GRID = PixelGrid.from_layout(RIGID_LAYOUT)


class Touch(NamedTuple):
    """A frame of a contact: time since the touch, excess, true force."""

    time_s: float
    excess: FloatArray
    saturated: bool
    force_n: float


class Bench:
    """A simulated sheet under one load after another: an array whose clock runs as it is read."""

    layout = RIGID_LAYOUT

    def __init__(self, *, seed: int, level: str) -> None:
        ranges, self.clock = ranges_of(level), ManualClock()
        self.rng = np.random.default_rng([seed, 77])
        self._sheet = draw_sheet(np.random.default_rng([seed, 0]), layout=self.layout, level=level)
        self._placements = Placements(sheet=self._sheet, grid=GRID, ranges=ranges, seed=seed)
        self._readout = Readout(
            sheet=self._sheet,
            layout=self.layout,
            oversampling=1,
            adc_noise_counts=ranges.adc_noise_counts,
            seed=seed,
            start_s=0.0,
        )
        self._frames = self._contacts = 0
        self._stamp = draw_object(self.rng, "dragonskin-20")
        self.place(self._stamp, force_n=lambda _: 0.0)
        unread = SampleReader(self.layout)
        rest = [unread.read(self.read()).resistance_ohm for _ in range(30)]
        self._reader = SampleReader(self.layout, np.mean(rest, axis=0))

    def place(
        self, obj: TwinObject, *, force_n: Callable[[float], float], stiffness: float = np.inf
    ) -> None:
        """Press an object from now on with a force that depends on the time since."""
        self._contacts += 1
        self._placed = self._placements.of(self._contacts, self._contacts, Environment())
        self._object, self._force_n, self._stiffness = obj, force_n, stiffness
        self._state = SheetState.at_rest(self.layout.pixels, creep=self._placed.creep)
        self._since_s = self.force_n = 0.0

    def lift(self) -> None:
        """Take the load off, and let the sheet rest."""
        self._force_n, self.force_n = lambda _: 0.0, 0.0
        self._state = SheetState.at_rest(self.layout.pixels, creep=self._placed.creep)
        self.clock.sleep_s(20.0)

    def read(self, *, timeout_s: float = 0.0) -> Frame:
        """Return the frame after the next frame interval."""
        del timeout_s
        self.clock.sleep_s(FRAME_S)
        self._since_s += FRAME_S
        last_n, self.force_n = self.force_n, self._force_n(self._since_s)
        placed, depth_mm = self._placed, self.force_n / self._stiffness
        fractions = pixel_fractions(
            self._object, depth_mm, grid=GRID, off_centre_mm=placed.off_centre_mm
        )
        self._state = self._state.advance(
            FRAME_S,
            self.force_n * fractions,
            travel_mm=abs(self.force_n - last_n) / self._stiffness,
            sheet=self._sheet,
            gain=placed.gain,
            creep=placed.creep,
        )
        ohm = self._state.resistance_ohm(self._sheet, creep=placed.creep)
        now_s = self.clock.now_s()
        grid_ohm = ohm.reshape(self.layout.rows, self.layout.cols)
        counts = self._readout.sample_counts(grid_ohm, time_s=now_s)
        self._frames += 1
        return Frame(time_s=now_s, sequence=self._frames, counts=counts)

    def close(self) -> None:
        """Do nothing."""

    def weigh(self) -> list[ForcePairs]:
        """Return all pairs after each weight; none if the product refuses the weights."""
        kept, found = KeptFrames(self), list[ForcePairs]()

        def place(load_n: float) -> None:
            self.lift()
            kept.read(timeout_s=0.0)
            self.place(self._stamp, force_n=ramp(load_n, self.rng.uniform(0.15, 0.6)))
            while self._since_s < 3.0:
                kept.read(timeout_s=0.0)

        try:
            measure_loads(
                kept, loads_n=LOADS_N, place=place, clock=self.clock, settled=found.append
            )
        except CalibrationError:
            return []
        return found

    def press(self, obj: TwinObject, load_n: float, rise_s: float, held_s: float) -> list[Touch]:
        """Return the frames of a held object, from the empty sheet on."""
        self.lift()
        found = list[Touch]()
        for step in range(1 + round((rise_s + held_s) / FRAME_S)):
            if step == 1:
                self.place(obj, force_n=ramp(load_n, rise_s), stiffness=STIFFNESS_N_PER_MM)
            sample, at_s = self._reader.read(self.read()), step * FRAME_S
            # Later the reading hardly changes: every tenth frame does.
            if at_s < rise_s + 4.0 or step % 10 == 0:
                saturated = bool(sample.saturated.any())
                found.append(Touch(at_s, sample.excess, saturated, self.force_n))
        return found


def ramp(load_n: float, rise_s: float) -> Callable[[float], float]:
    """Return a force that rises linearly and then stays."""
    return lambda at_s: load_n * min(at_s / rise_s, 1.0)


def read_power(frames: Sequence[Touch], *, line: FloatArray) -> FloatArray:
    """Return what `read_law` does, by a power law without interval; `line`: slope and offset."""
    total = np.maximum([total_excess(one.excess) for one in frames], 1e-9)
    value, nothing = np.exp(np.polyval(line, np.log(total))), np.full(len(frames), np.nan)
    certain = np.where([one.saturated for one in frames], np.inf, value)
    return np.stack([value, nothing, nothing, certain])


def read_law(frames: Sequence[Touch], *, law: SheetLaw) -> FloatArray:
    """Return value, low, high, and the force that a guard compares with its limit: (4, frames)."""
    source = follow_force(law, finger_of_row=RIGID_LAYOUT.finger_of_row)
    found = [source.step(one.time_s, one.excess, saturated=one.saturated) for one in frames]
    return np.array(
        [
            (one.middle, one.low, one.high, one.quantile(USUAL_CERTAINTY))
            if one.has_value
            else (np.nan, np.nan, np.nan, np.inf)
            for one in found
        ]
    ).T


def run_sheet(seed: int, level: str) -> Iterator[tuple[int, str, list[list[float]], list[float]]]:
    """Yield number of weights, method, its answers, and the true forces at its stops.

    An answer is the time after the load, the load, and value, low and high of the method.
    """
    bench = Bench(seed=seed, level=level)
    weighed, held, closings = bench.weigh(), list[tuple[float, list[int], list[Touch]]](), []
    for _ in range(OBJECTS_PER_SHEET if weighed else 0):
        obj = draw_object(bench.rng)
        load_n, rise_s, rate_n_per_s = np.exp(bench.rng.uniform(*np.log(DRAWN).T)).tolist()
        frames = bench.press(obj, load_n, rise_s, AFTER_S[-1] + 1.0)
        time_s = np.array([one.time_s for one in frames])
        rows = [int(np.argmin(np.abs(time_s - rise_s - after_s))) for after_s in AFTER_S]
        if not any(one.saturated for one in frames):
            held.append((load_n, rows, frames))
        closings.append(bench.press(obj, LARGEST_N, LARGEST_N / rate_n_per_s, 0.0))
    for count in COUNTS:
        try:
            pairs = weighed[count - 1]
            laws = [
                fit_sheet_law(one, layout=RIGID_LAYOUT) for one in (pairs, settled_pairs(pairs))
            ]
        except (IndexError, CalibrationError):
            continue
        settled = settled_pairs(pairs)
        line = np.polyfit(np.log(settled.excess), np.log(settled.force_n), 1)
        methods = *(partial(read_law, law=law) for law in laws), partial(read_power, line=line)
        for name, read in zip(METHODS, methods, strict=True):
            answers = [
                [after_s, load_n, *found]
                for load_n, rows, frames in held
                for after_s, found in zip(AFTER_S, read(frames)[:3, rows].T, strict=True)
            ]
            passed = [(frames, read(frames)[3] > LIMIT_N) for frames in closings]
            # A guard that never stops lets the force rise to the end.
            stops_n = [
                frames[int(np.argmax(one)) if one.any() else -1].force_n for frames, one in passed
            ]
            yield count, name, answers, stops_n


def report(answers: FloatArray, stops_n: FloatArray) -> None:
    """Print the figures of a method."""
    for after_s in AFTER_S:
        _, load_n, value, low, high = answers[answers[:, 0] == after_s].T
        text = f"    {after_s:g} s: error {np.median(np.abs(value - load_n)):.2f} N"
        if np.isfinite(high).all():
            covered = np.mean((low <= load_n) & (load_n <= high))
            text += f", covered {covered:.3f}, half-width {np.median(high - low) / 2:.2f} N"
        print(f"{text} (n = {load_n.size})")
    least_n, middle_n, most_n = np.quantile(stops_n, (0.1, 0.5, 0.9))
    print(
        f"    guard at {LIMIT_N:g} N: stops at {middle_n:.2f} N ({least_n:.2f} to {most_n:.2f}), "
        f"above in {np.mean(stops_n > LIMIT_N):.3f} (n = {stops_n.size})",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sheets", type=int, default=60, help="of each level (60)")
    parser.add_argument("--seed", type=int, default=9_900_000, help="of the first sheet")
    parser.add_argument("--level", choices=LEVELS, help="only this one")
    options = parser.parse_args()
    for level in [options.level] if options.level else LEVELS:
        answers = defaultdict[tuple[int, str], list[list[float]]](list)
        stops = defaultdict[tuple[int, str], list[float]](list)
        accepted = Counter[int]()
        for seed in range(options.seed, options.seed + options.sheets):
            for count, name, new, stops_n in run_sheet(seed, level):
                accepted[count] += name == METHODS[0]
                answers[count, name] += new
                stops[count, name] += stops_n
        for count, name in answers:
            if name == METHODS[0]:
                print(f"{level}, {count} weights, {accepted[count]} of {options.sheets} sheets")
            print(f"  {name}:")
            report(np.array(answers[count, name]), np.array(stops[count, name]))


if __name__ == "__main__":
    main()
