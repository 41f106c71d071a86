"""Slip and removal: detection rate, delay and false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import chi2

from palpate.arrays import FloatArray
from palpate.sensor.sample import SampleReader
from palpate.signal.events import ContactState, EventKind, watch_contact
from palpate.signal.relative import CONTACT_PERCENT, finger_means
from palpate.twin.devices import TwinArray
from palpate.twin.friction import N_PER_G
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import ranges_of
from palpate.twin.readout import Readout
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, median, running_median
from palpate_studies.twin_session import Session

FIRST_SENSOR = 30_000
#: Objects to hold.
OBJECTS = ("strawberry", "tomato", "apple", "avocado-day-3", "mango", "ball-44lbs")
KINDS = ("slip", "removal")
#: Closure beyond contact, mm; time from the grip to the event, and observation after it, seconds.
CLOSURES_MM, HOLDS_S, AFTER_S = (1.0, 3.0), (1.5, 4.0), 1.0
#: Pull of a slip relative to the limit of friction.
PULLS = (1.02, 1.5)
#: Duration of a quiet hold, and time step of the simulated sheet resistance in it, seconds.
QUIET_S, QUIET_STEP_S = 600.0, 0.5
#: Mean change of a detected grip; weaker grips are not scored.
_HELD_PERCENT = -10.0


def report(
    *,
    events: Annotated[int, typer.Option(help="Slips and removals of each level.", min=2)] = 60,
    hours: Annotated[float, typer.Option(help="Quiet holding of each level.", min=0.1)] = 0.5,
) -> StudyReport:
    """Let simulated objects slip or disappear, and hold other objects quietly for hours.

    Example: palpate study slip --events 500 --hours 10 --out reports
    """
    holds = max(round(3600.0 * hours / QUIET_S), 1)
    summary, alarms = list[dict[str, Any]](), list[dict[str, Any]]()
    for level in LEVELS:
        for index, kind in enumerate(KINDS):
            happened = [
                _simulate_event(level, sensor=FIRST_SENSOR + n // 10, trial=n % 10, kind=kind)
                for n in range(index, events, len(KINDS))
            ]
            summary.append({"level": level, "kind": kind, **_scores(happened)})
        quiet = [_watch_quiet_hold(level, sensor=FIRST_SENSOR + n) for n in range(holds)]
        alarms.append({"level": level, **_score_alarms(quiet)})
    return StudyReport(
        name="slip",
        title="Slip and removal on the twin (simulated)",
        provenance=[
            f"Simulated: {events} events per level, ten per sensor from seed {FIRST_SENSOR}, "
            f"frames at 15 Hz. A slip is a pull of {PULLS[0]:g} to {PULLS[1]:g} times the limit of "
            "friction. An event counts as detected if a finger reports slip or removal within one "
            "second, by the rules of `palpate.signal.events`.",
            "Only grips that both fingers detect before the event (mean change below -10 %) are "
            "scored. A sliding object leaves the pads within one or two frames; short slips that "
            "stop again are not simulated.",
            f"Quiet: {holds} holds of {QUIET_S:g} s per level, each on its own sensor. The sheet "
            f"resistance is simulated every {QUIET_STEP_S:g} s and interpolated linearly; noise of "
            "sheet and converter is added to every frame.",
        ],
        tables=[
            Table.of("Slips and removals detected within a second", summary),
            Table.of("False slips and removals in quiet holds", alarms),
        ],
        payload={"origin": "twin", "summary": summary, "quiet": alarms},
    )


command = as_command(report)


def _simulate_event(level: str, *, sensor: int, trial: int, kind: str) -> tuple[bool, list[float]]:
    """Simulate a slip or removal of a held object.

    Returns whether both fingers had contact before the event, and the times of reported slips and
    removals relative to the event, seconds. Negative times are false alarms.
    """
    rng = np.random.default_rng([sensor, trial, 51])
    session = Session(sensor, level=level, trial=trial)
    obj, rest_ohm = _hold(session, rng)
    world, array = session.world, TwinArray(session.world)
    event_s = world.clock.now_s() + float(rng.uniform(*HOLDS_S))
    frames, times = [], []
    has_started = False
    while world.clock.now_s() < event_s + AFTER_S:
        if not has_started and world.clock.now_s() + 1 / world.frame_rate_hz > event_s:
            has_started, pull = True, float(rng.uniform(*PULLS))
            if kind == "removal":
                world.place(None, time_s=event_s)
            else:
                holds_n = 2.0 * obj.friction * world.force_n(event_s)
                world.lift(more_n=pull * holds_n - N_PER_G * obj.mass_g, time_s=event_s)
        frame = array.read(timeout_s=1.0)
        times.append(frame.time_s)
        frames.append(frame.counts)
    array.close()
    fingers = _finger_changes(np.stack(frames), session=session, rest_ohm=rest_ohm)
    before = fingers[np.array(times) < event_s]
    return _has_contact(before[-5:]), [
        at_s - event_s for at_s in _find_loss_times_s(times, fingers)
    ]


def _hold(session: Session, rng: np.random.Generator) -> tuple[TwinObject, FloatArray]:
    """Measure rest values and close on an object; return object and rest values."""
    obj = draw_object(rng, str(rng.choice(OBJECTS)))
    session.place(obj)
    session.close_to(obj.size_mm + 6.0)
    session.world.clock.sleep_s(1.0)
    rest_ohm = session.mean_ohm()
    session.close_to(obj.size_mm - float(rng.uniform(*CLOSURES_MM)))
    session.world.clock.sleep_s(1.0)
    return obj, rest_ohm


def _finger_changes(counts: np.ndarray, *, session: Session, rest_ohm: FloatArray) -> FloatArray:
    """Return each finger's mean relative change, shape (frames, fingers)."""
    layout = session.world.layout
    change = SampleReader(layout, rest_ohm).read_counts(counts).change_percent
    return finger_means(change, finger_of_row=layout.finger_of_row)


def _has_contact(fingers: FloatArray) -> bool:
    """Return whether every finger has contact in the median of some frames."""
    return bool((np.median(fingers, axis=0) < _HELD_PERCENT).all())


def _find_loss_times_s(time_s: Sequence[float] | FloatArray, fingers: FloatArray) -> list[float]:
    """Return the times of slips and removals in changes of shape (frames, fingers)."""
    found, states = list[float](), [ContactState()] * fingers.shape[1]
    for now_s, changes in zip(time_s, running_median(fingers, length=3), strict=True):
        for finger, change in enumerate(changes.tolist()):
            states[finger], kind = watch_contact(
                states[finger], change, threshold_percent=CONTACT_PERCENT
            )
            if kind in (EventKind.SLIP, EventKind.REMOVAL):
                found.append(float(now_s))
    return found


def _watch_quiet_hold(level: str, *, sensor: int) -> tuple[int, bool]:
    """Hold an object quietly; return the number of alarms and whether it had contact."""
    session = Session(sensor, level=level)
    _, rest_ohm = _hold(session, np.random.default_rng([sensor, 52]))
    world = session.world
    begin_s = world.clock.now_s()
    steps_s = begin_s + np.arange(0.0, QUIET_S + QUIET_STEP_S, QUIET_STEP_S)
    ohm = np.stack([world.pixel_resistance_ohm(float(at_s)) for at_s in steps_s])
    frames_s = begin_s + np.arange(0.0, QUIET_S, 1 / world.frame_rate_hz)
    readout = Readout(
        sheet=world.sheet,
        layout=world.layout,
        oversampling=world.oversampling,
        adc_noise_counts=ranges_of(level).adc_noise_counts,
        seed=sensor,
        start_s=begin_s,
    )
    place = (frames_s - begin_s) / QUIET_STEP_S
    index = np.minimum(place.astype(int), len(steps_s) - 2)
    between = ohm[index] + (place - index)[:, None, None] * (ohm[index + 1] - ohm[index])
    counts = np.stack(
        [
            readout.sample_counts(now_ohm, time_s=at_s)
            for now_ohm, at_s in zip(between, frames_s.tolist(), strict=True)
        ]
    )
    fingers = _finger_changes(counts, session=session, rest_ohm=rest_ohm)
    return len(_find_loss_times_s(frames_s, fingers)), _has_contact(fingers[:15])


def _scores(found: Sequence[tuple[bool, list[float]]]) -> dict[str, Any]:
    gripped = [times for held, times in found if held]
    delays = [min(after) for times in gripped if (after := [at_s for at_s in times if at_s >= 0])]
    return {
        "events": len(found),
        "felt_before": len(gripped),
        "seen": len(delays),
        "rate": len(delays) / len(gripped) if gripped else None,
        "median_delay_s": median(delays),
        "p95_delay_s": median(delays, 0.95),
        "called_before": sum(at_s < 0 for times in gripped for at_s in times),
    }


def _score_alarms(holds: Sequence[tuple[int, bool]]) -> dict[str, Any]:
    counts = [alarms for alarms, held in holds if held]
    alarms, hours = sum(counts), len(counts) * QUIET_S / 3600.0
    return {
        "holds": len(holds),
        "felt": len(counts),
        "hours": hours,
        "called": alarms,
        "per_hour": alarms / hours if hours else None,
        # Poisson upper limit (95 %): without alarms, three divided by the hours.
        "per_hour_at_most": float(chi2.ppf(0.95, 2 * alarms + 2) / (2 * hours)) if hours else None,
    }
