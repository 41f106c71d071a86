"""Compare the twin with real recordings in scatter, creep, curve shapes and noise.

The same quantities are computed for real recordings and for ladders of loads, presses and holds on
the twin. A twin whose value is below the interval of the recordings is called kinder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.holds import Hold, measure_settled_value, read_holds
from palpate.scoring.predictions import predict_holds
from palpate.sensor.array import ArrayLayout
from palpate.sensor.sample import SampleReader
from palpate.settling.exponential import Exponential
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod
from palpate.signal.circuit import Divider
from palpate_studies.force_ladders import read_ladders
from palpate_studies.press_data import Press, Trace, read_presses
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import SPEED_MM_PER_S, STILL_S, Session, draw_named

CUTOFF_S, HORIZON_S = 2.5, 20.0
#: Loads below this are not compared.
SMALLEST_N = 0.5
#: Creep is the change between these times after the force is reached, corrected for the force.
CREEP_FROM_S, CREEP_TO_S = 0.2, 1.2
#: Fewest sampling steps in a rise for an estimate of its slope: three at 15 Hz are 0.2 s.
FEWEST_RISING = 3
#: Places pressed at once by an object on the twin's sheet, and draws of as many real places.
PLACES, _DRAWS = 8, 2000
#: Load and excess conductance of one sensor, one pair per weight.
Ladder = tuple[FloatArray, FloatArray]
#: A converter with negligible quantisation relative to the scatter of the sheet.
FINE = ArrayLayout(
    name="fine", rows=4, cols=2, finger_of_row=(0, 0, 1, 1), divider=Divider(adc_bits=16)
)
#: Closures on springs for about 0.5 to 12 N, on springs for about 7 N, and on a ball for holds.
LADDER_MM = tuple(np.geomspace(0.3, 4.2, 18))
PRESS_MM, WEIGHT_MM = 3.0, 2.5
#: The real ladders were read 5-15 s after loading.
LADDER_HOLD_S = 10.0
PRESS_S, PRESS_MM_PER_S = 2.0, 10.0
SENSORS, PRESSES, HOLDS = 12, 8, 3
#: Quantity -> its meaning.
MEANING = {
    "exponent": "of excess conductance in force, sensor by sensor (standard deviation compared)",
    "scatter of ln force": "about the sensor's own power law, every weight placed again",
    "ln force missed": "by the power law of two other sensors",
    "gain scatter": "sd of ln conductance at equal force, place to place",
    "gain scatter, eight places": "pressed together",
    "gain from eight places to the next": "difference / sqrt 2 of half sheets",
    "creep, %": "of conductance within 1 s of the plateau, corrected for the force",
    "still to come, %": "of the settled ohm value at 2.5 s",
    "noise, %": "of one sample on a settled hold",
    "relaxation error, %": "at 2.5 s, of the settled ohm value",
    "relaxation error, % of rest": "of the change still to come",
    "exponential error, %": "at 2.5 s, of the settled ohm value",
    "exponential error, % of rest": "of the change still to come",
}
Quantities = Mapping[str, FloatArray]


def ladder_quantities(ladders: Sequence[Ladder]) -> dict[str, FloatArray]:
    """Return exponent, own scatter and error of the other ladders' law, per ladder.

    Each ladder is predicted from two others, because there are three real ladders.
    """
    logs = [(np.log(load), np.log(excess)) for load, excess in ladders]
    lines = [np.polyfit(load, excess, 1) for load, excess in logs]
    scatter = [
        np.std(excess - np.polyval(line, load), ddof=2) / abs(line[0])
        for (load, excess), line in zip(logs, lines, strict=True)
    ]
    missed = []
    for index, (load, excess) in enumerate(logs):
        others = [logs[(index + step) % len(logs)] for step in (1, 2)]
        loads, excesses = (np.concatenate(part) for part in zip(*others, strict=True))
        learned = np.polyfit(loads, excesses, 1)
        missed.append(np.median(np.abs((excess - learned[1]) / learned[0] - load)))
    return {
        "exponent": np.array([line[0] for line in lines]),
        "scatter of ln force": np.array(scatter),
        "ln force missed": np.array(missed),
    }


def press_quantities(presses: Sequence[Press]) -> dict[str, FloatArray]:
    """Return the gain's scatter per recording and the creep of each press."""
    exponent = _within_press_exponent(presses)
    creeps = []
    for press in presses:
        time_s, log_gain = _track_held_gain(press, exponent)
        if time_s[-1] >= CREEP_TO_S:
            early, late = np.interp([CREEP_FROM_S, CREEP_TO_S], time_s, log_gain)
            creeps.append(100 * np.expm1(late - early))
    gains = list_log_gains(presses)
    scatter = [np.std(gain, ddof=1) for gain in gains.values() if len(gain) > 2]
    return {"gain scatter": np.array(scatter), "creep, %": np.array(creeps)}


def list_log_gains(presses: Sequence[Press]) -> dict[str, FloatArray]:
    """Return each press's ln conductance at equal force, by recording."""
    exponent = _within_press_exponent(presses)
    gains: dict[str, list[float]] = {}
    for press in presses:
        gains.setdefault(press.recording_id, []).append(
            float(_track_held_gain(press, exponent)[1][0])
        )
    return {name: np.array(gain) for name, gain in gains.items()}


def _track_held_gain(press: Press, exponent: float) -> tuple[FloatArray, FloatArray]:
    """Return time since the force was reached, and ln conductance corrected for the force."""
    trace = press.trace
    held = slice(trace.given, press.last_held + 1)
    log_gain = _clip_log(trace.excess[held]) - exponent * _clip_log(trace.force_n[held])
    return trace.time_s[held] - trace.time_s[trace.given], log_gain


def scatter_of_drawn_means(gains: Mapping[str, FloatArray]) -> FloatArray:
    """Return the scatter of the mean conductance of eight places drawn from each recording.

    It is the scatter of a sheet of eight pixels if the pixels are independent places.
    """
    rng = np.random.default_rng(0)
    drawn = [
        np.exp(rng.choice(gain, (_DRAWS, PLACES))).mean(axis=1)
        for gain in gains.values()
        if len(gain) >= PLACES
    ]
    return np.array([np.std(np.log(mean)) for mean in drawn])


def half_sheet_differences(gains: Mapping[str, FloatArray]) -> FloatArray:
    """Return |difference| / sqrt(2) of ln mean conductance of the first and last eight places.

    Neighbouring places are pressed in sequence and are similar, so averaging reduces the scatter
    less.
    """
    return np.array(
        [
            abs(np.log(np.exp(gain[:PLACES]).mean() / np.exp(gain[-PLACES:]).mean())) / np.sqrt(2)
            for gain in gains.values()
            if len(gain) >= 2 * PLACES
        ]
    )


def _within_press_exponent(presses: Sequence[Press]) -> float:
    """Return the slope of ln excess over ln force within loadings."""
    forces: list[FloatArray] = []
    excesses: list[FloatArray] = []
    for press in presses:
        trace = press.trace
        rising = slice(trace.first, trace.given + 1)
        if trace.given - trace.first >= FEWEST_RISING:
            for found, values in ((forces, trace.force_n), (excesses, trace.excess)):
                log = _clip_log(values[rising])
                found.append(log - log.mean())
    force, excess = np.concatenate(forces), np.concatenate(excesses)
    return float(force @ excess / (force @ force))


def _clip_log(values: FloatArray) -> FloatArray:
    return np.log(np.maximum(values, 1e-3))


def hold_quantities(holds: Sequence[Hold]) -> dict[str, FloatArray]:
    """Return each hold's remaining change at 2.5 s, predictors' errors, and noise."""
    long, to_come, noise = list[Hold](), list[float](), list[float]()
    for hold in holds:
        settled = measure_settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
        if not settled > 0:
            continue
        long.append(hold)
        to_come.append(100 * (np.interp(CUTOFF_S, hold.time_s, hold.values) / settled - 1))
        # Noise of one sample, from second differences in the second half.
        half = (hold.time_s > HORIZON_S / 2) & (hold.time_s <= HORIZON_S)
        second = np.diff(hold.values[half], 2)
        noise.append(100 * np.sqrt(np.mean(second**2) / 6) / settled)
    found = {"still to come, %": np.array(to_come), "noise, %": np.array(noise)}
    methods: dict[str, SettlingMethod] = {"relaxation": Relaxation(), "exponential": Exponential()}
    predictions = list(
        predict_holds(long, methods=methods, cutoffs_s=[CUTOFF_S], horizon_s=HORIZON_S, level=0.9)
    )
    for name in methods:
        rows = [one for one in predictions if one.method == name]
        found[f"{name} error, %"] = np.abs([row.error_percent for row in rows])
        found[f"{name} error, % of rest"] = np.array([row.of_remaining_percent for row in rows])
    return found


def simulate_ladder(sensor: int, *, level: str) -> Ladder:
    """Load one sensor in steps, placing the springs again, and read it after 10 s."""
    session, springs = Session(sensor, level=level, layout=FINE), draw_named("springs-8")
    pairs = []
    for closure_mm in LADDER_MM:
        session.place(springs)
        width_mm = springs.size_mm - closure_mm
        reading = session.grasp(springs.size_mm, width_mm=width_mm, hold_s=LADDER_HOLD_S)
        pairs.append((reading.force_n, reading.excess))
    load, excess = np.array(pairs).T
    compared = (load > SMALLEST_N) & (excess > 0)
    return load[compared], excess[compared]


def simulate_presses(sensor: int, *, level: str, count: int) -> tuple[list[Press], list[Press]]:
    """Press one sensor `count` times; return presses of one pixel and of all.

    A real indenter presses several places of a single-pixel sheet in turn. Here each press uses
    another pixel as the place. The sum over all pixels averages the places.
    """
    session, face = Session(sensor, level=level, layout=FINE, trial=1), draw_named("springs-8")
    found: tuple[list[Press], list[Press]] = [], []
    for number in range(count):
        session.place(face)
        clock_s, excess, force_n = _press(session, face.size_mm)
        for presses, seen in zip(
            found, (excess[:, number % FINE.pixels], excess.sum(axis=1)), strict=True
        ):
            trace = Trace(
                time_s=clock_s,
                excess=seen,
                force_n=force_n,
                first=int(np.argmax(force_n > SMALLEST_N)),
                given=int(np.argmax(force_n >= 0.95 * force_n.max())),
                group=str(sensor),
            )
            last = len(clock_s) - 1
            presses.append(
                Press(recording_id=str(sensor), press=number, trace=trace, last_held=last)
            )
    return found


def _press(session: Session, size_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Press once; return time, excess of each pixel, shape (times, pixels), and force."""
    session.close_to(size_mm + 1.0)
    session.world.clock.sleep_s(STILL_S)
    rest_ohm = session.mean_ohm()
    session.close_to(size_mm - PRESS_MM, speed_mm_per_s=PRESS_MM_PER_S)
    ohm, cell, clock_s = [], [], []
    until_s = session.world.clock.now_s() + PRESS_S
    while session.world.clock.now_s() < until_s:
        ohm.append(session.read(1 / session.world.frame_rate_hz)[-1])
        cell.append(session.cell.read_n())
        clock_s.append(session.world.clock.now_s())
    pixels = SampleReader(session.world.layout, rest_ohm).read_ohm(ohm)
    return np.array(clock_s), pixels.excess.reshape(len(ohm), -1), np.array(cell)


def simulate_holds(sensor: int, *, level: str, count: int) -> list[Hold]:
    """Hold a ball for 20 s, `count` times; parallel pixels, ohm, time 0 at standstill.

    The real recordings start at standstill too: the contact is missing, or the sensor was already
    strained.
    """
    session, ball = Session(sensor, level=level, layout=FINE, trial=2), draw_named("ball-44lbs")
    holds = []
    for number in range(count):
        session.place(ball)
        session.close_to(ball.size_mm + 1.0)
        session.world.clock.sleep_s(STILL_S)
        session.close_to(ball.size_mm - WEIGHT_MM)
        ohm = 1.0 / np.mean(1.0 / session.read(HORIZON_S + 1.0), axis=(1, 2))
        time_s = np.arange(len(ohm)) / session.world.frame_rate_hz
        peak = int(np.searchsorted(time_s, (1.0 + WEIGHT_MM) / SPEED_MM_PER_S))
        holds.append(
            Hold(
                hold_id=f"{sensor}_h{number:02}",
                channel=None,
                time_s=time_s[peak:] - time_s[peak],
                values=ohm[peak:],
            )
        )
    return holds


def report(
    *,
    ladders: Annotated[Path, typer.Option(help="Real ladders of weights.", metavar="CSV")],
    presses: Annotated[Path, typer.Option(help="Real presses with a load cell.", metavar="CSV")],
    holds: Annotated[Path, typer.Option(help="Real holds in ohm.", metavar="FILE")],
    sensors: int = SENSORS,
) -> StudyReport:
    """Compare the twin's scatter, creep, shapes and noise with those of real recordings.

    Example: palpate study realism --ladders ladders.csv --presses presses.csv.gz --holds holds.csv
    """
    real = real_quantities(ladders=ladders, presses=presses, holds=holds)
    twin = {level: twin_quantities(level=level, sensors=sensors) for level in LEVELS}
    rows = [
        compare(quantity, real[quantity], {level: twin[level][quantity] for level in LEVELS})
        for quantity in MEANING
    ]
    return StudyReport(
        name="realism",
        title="The twin compared with real recordings",
        provenance=[
            f"Simulated: {sensors} sensors of each level, {PRESSES} presses and {HOLDS} holds of "
            "each sensor, read with 16 bit so that quantisation is negligible. Real: the given "
            "files.",
            "The ranges of `field` were set with this comparison, so agreement is no evidence for "
            "an estimator. The scatter of `lab` is that of the paper's Tables 2 to 6.",
            "Real places have the same gain in every press. The twin draws new gains for each "
            "grasp, so its half sheets are two grasps with eight pixels each.",
            "Kinder: the twin's median (or sd) is below the bootstrap 90 % interval of the real "
            "recordings.",
        ],
        tables=[
            Table.of(
                "Value compared (10 to 90 %)",
                rows,
                {
                    "quantity": lambda row: f"{row['quantity']}: {MEANING[row['quantity']]}",
                    "n": "{n}",
                    "real": "{real}",
                    **{level: f"{{{level}}}" for level in LEVELS},
                },
            )
        ],
        payload={"origin": "twin", "compared": rows},
    )


command = as_command(report)


def compare(quantity: str, real: FloatArray, twin: Quantities) -> dict[str, Any]:
    """Compare a quantity of recordings and twin, and mark values below the real interval."""
    of = np.nanstd if quantity == "exponent" else np.nanmedian
    drawn = np.random.default_rng(0).choice(real, size=(2000, real.size))
    lowest = float(np.quantile(of(drawn, axis=1), 0.05))

    def cell(values: FloatArray) -> str:
        low, high = np.nanquantile(values, [0.1, 0.9])
        return f"{of(values):.3g} ({low:.3g} to {high:.3g})"

    kinder = {level: bool(of(values) < lowest) for level, values in twin.items()}
    return {
        "quantity": quantity,
        "n": real.size,
        "real": cell(real),
        **{level: cell(twin[level]) + ", kinder" * kinder[level] for level in twin},
        "kinder": kinder,
    }


def real_quantities(*, ladders: Path, presses: Path, holds: Path) -> Quantities:
    """Return the quantities of real recordings."""
    pressed = read_presses(presses)
    gains = list_log_gains(pressed)
    return {
        **ladder_quantities(
            [
                (one.load_n[loaded], one.rest_ohm / one.resistance_ohm[loaded] - 1.0)
                for one in read_ladders(ladders)
                for loaded in [one.load_n > SMALLEST_N]
            ]
        ),
        **press_quantities(pressed),
        "gain scatter, eight places": scatter_of_drawn_means(gains),
        "gain from eight places to the next": half_sheet_differences(gains),
        **hold_quantities(read_holds(holds)),
    }


def twin_quantities(*, level: str, sensors: int = SENSORS) -> Quantities:
    """Return the same quantities of the twin."""
    pressed = [simulate_presses(sensor, level=level, count=PRESSES) for sensor in range(sensors)]
    one, summed = ([p for pair in pressed for p in pair[part]] for part in (0, 1))
    gains = np.array(list(list_log_gains(summed).values()))
    return {
        **ladder_quantities([simulate_ladder(sensor, level=level) for sensor in range(sensors)]),
        **press_quantities(one),
        "gain scatter, eight places": np.std(gains, axis=1, ddof=1),
        "gain from eight places to the next": np.abs(np.diff(gains, axis=1)).ravel() / np.sqrt(2),
        **hold_quantities(
            [
                h
                for sensor in range(sensors)
                for h in simulate_holds(sensor, level=level, count=HOLDS)
            ]
        ),
    }
