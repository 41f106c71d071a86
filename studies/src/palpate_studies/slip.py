"""Slip and removal: how surely and how soon they are seen, and how often nothing is called one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import chi2

from palpate.arrays import FloatArray
from palpate.signal.circuit import resistance_ohm
from palpate.signal.events import EventKind
from palpate.signal.relative import finger_means, relative_change_percent
from palpate.twin.devices import TwinArray
from palpate.twin.friction import N_PER_G
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import ranges_of
from palpate.twin.readout import Readout
from palpate_studies.contact_events import contact_events
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, median
from palpate_studies.twin_session import Session

FIRST_SENSOR = 30_000
#: What is held, in turn.
OBJECTS = ("strawberry", "tomato", "apple", "avocado-day-3", "mango", "ball-44lbs")
KINDS = ("slip", "removal")
#: Width that the fingers close by, beyond contact; how long it is held before something happens;
#: how long the watch goes on.
CLOSURES_MM, HOLDS_S, AFTER_S = (1.0, 3.0), (1.5, 4.0), 1.0
#: The pull of a slip, as a multiple of what friction holds.
PULLS = (1.02, 1.5)
#: One quiet hold, and how far apart the sheet's own resistance is worked out in it, seconds.
QUIET_S, QUIET_STEP_S = 600.0, 0.5
#: Weaker grips than this are not looked at: the paper's threshold is not reached on every sheet.
_HELD_PERCENT = -10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Happening:
    """One event.

    Attributes
    ----------
    kind : str
        In `KINDS`.
    held : bool
        Whether both fingers felt the object before: what is not felt can't be missed.
    delay_s : float or None
        From its beginning to when a finger reported it; None if none did.
    false : int
        Slips and removals called before it.
    """

    kind: str
    held: bool
    delay_s: float | None
    false: int


def report(
    *,
    events: Annotated[int, typer.Option(help="Slips and removals of each level.", min=2)] = 60,
    hours: Annotated[float, typer.Option(help="Quiet holding of each level.", min=0.1)] = 0.5,
) -> StudyReport:
    """Let simulated objects slip or vanish, and hold others quietly for hours.

    Example: palpate study slip --events 500 --hours 10 --out reports
    """
    happened = {
        level: [
            _happening(level, sensor=FIRST_SENSOR + n // 10, trial=n % 10, kind=KINDS[n % 2])
            for n in range(events)
        ]
        for level in LEVELS
    }
    holds = max(round(3600.0 * hours / QUIET_S), 1)
    quiet = {
        level: [_quiet(level, sensor=FIRST_SENSOR + n) for n in range(holds)] for level in LEVELS
    }
    summary = [
        {"level": level, "kind": kind, **_scores([h for h in happened[level] if h.kind == kind])}
        for level in LEVELS
        for kind in KINDS
    ]
    alarms = [{"level": level, **_alarms(quiet[level])} for level in LEVELS]
    return StudyReport(
        name="slip",
        title="Slip and removal on the twin (simulated)",
        provenance=[
            f"Simulated: {events} events per level, frames at 15 Hz, ten on each sensor, from seed "
            f"{FIRST_SENSOR}; a slip is a pull of {PULLS[0]:g} to {PULLS[1]:g} times what friction "
            "holds. Seen means that a finger calls slip or removal within a second, by the rules "
            "of `palpate.signal.events` that run live.",
            "Counted are grips that both fingers feel before (mean change below -10 %). Once it "
            "slides, an object is off the pads within a frame or two; one that slides a little and "
            "is caught again is not simulated.",
            f"Quiet: {holds} holds of {QUIET_S:g} s per level, a sensor each; the sheet's own "
            f"course worked out every {QUIET_STEP_S:g} s and drawn straight between, its noise and "
            "the converter's drawn for every frame.",
        ],
        tables=[
            Table.of("Slips and removals seen within a second", summary),
            Table.of("Slips and removals called in quiet holds", alarms),
        ],
        payload={"study": "slip", "origin": "twin", "summary": summary, "quiet": alarms},
    )


command = as_command(report)


def _happening(level: str, *, sensor: int, trial: int, kind: str) -> Happening:
    rng = np.random.default_rng([sensor, trial, 51])
    session = Session(sensor, level=level, trial=trial)
    obj, rest_ohm = _hold(session, rng)
    world, array = session.world, TwinArray(session.world)
    event_s = world.clock.now_s() + float(rng.uniform(*HOLDS_S))
    frames, times = [], []
    begun = False
    while world.clock.now_s() < event_s + AFTER_S:
        if not begun and world.clock.now_s() + 1 / world.frame_rate_hz > event_s:
            _begin(session, obj, kind=kind, pull=float(rng.uniform(*PULLS)), time_s=event_s)
            begun = True
        frame = array.read(timeout_s=1.0)
        times.append(frame.time_s)
        frames.append(frame.counts)
    array.close()
    return _judged(session, np.array(times), np.stack(frames), rest_ohm, event_s=event_s, kind=kind)


def _hold(session: Session, rng: np.random.Generator) -> tuple[TwinObject, FloatArray]:
    """Take rest values and close on an object; return it and them."""
    obj = draw_object(rng, str(rng.choice(OBJECTS)))
    session.place(obj)
    session.close_to(obj.size_mm + 6.0)
    session.world.clock.sleep_s(1.0)
    rest_ohm = session.mean_ohm()
    session.close_to(obj.size_mm - float(rng.uniform(*CLOSURES_MM)))
    session.world.clock.sleep_s(1.0)
    return obj, rest_ohm


def _begin(session: Session, obj: TwinObject, *, kind: str, pull: float, time_s: float) -> None:
    world = session.world
    if kind == "removal":
        world.place(None, time_s=time_s)
        return
    holds_n = 2.0 * obj.friction * world.force_n(time_s)
    world.lift(more_n=pull * holds_n - N_PER_G * obj.mass_g, time_s=time_s)


def _judged(
    session: Session,
    time_s: FloatArray,
    counts: np.ndarray,
    rest_ohm: FloatArray,
    *,
    event_s: float,
    kind: str,
) -> Happening:
    fingers = _fingers(counts, session=session, rest_ohm=rest_ohm)
    before = time_s < event_s
    called = [
        event.time_s
        for event in contact_events(time_s, fingers)
        if event.kind in (EventKind.SLIP, EventKind.REMOVAL)
    ]
    after = [at_s - event_s for at_s in called if at_s >= event_s]
    held = bool((np.median(fingers[before][-5:], axis=0) < _HELD_PERCENT).all())
    return Happening(
        kind=kind,
        held=held,
        delay_s=min(after) if after else None,
        false=sum(at_s < event_s for at_s in called),
    )


def _fingers(counts: np.ndarray, *, session: Session, rest_ohm: FloatArray) -> FloatArray:
    """Return each finger's mean relative change, shape (frames, fingers)."""
    layout = session.world.layout
    ohm = resistance_ohm(counts, divider=layout.divider)
    change = relative_change_percent(ohm, rest_ohm=rest_ohm)
    return finger_means(change, finger_of_row=layout.finger_of_row)


def _quiet(level: str, *, sensor: int) -> tuple[float, int, bool]:
    """Hold an object for long; return hours, slips and removals called, and whether it was felt."""
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
        crosstalk=False,
        seed=sensor,
        start_s=begin_s,
    )
    counts = np.stack(
        [
            readout.counts(_between(steps_s, ohm, float(at_s)), time_s=float(at_s))
            for at_s in frames_s
        ]
    )
    fingers = _fingers(counts, session=session, rest_ohm=rest_ohm)
    lost = (EventKind.SLIP, EventKind.REMOVAL)
    called = sum(event.kind in lost for event in contact_events(frames_s, fingers))
    held = bool((np.median(fingers[:15], axis=0) < _HELD_PERCENT).all())
    return QUIET_S / 3600.0, called, held


def _between(steps_s: FloatArray, ohm: FloatArray, at_s: float) -> FloatArray:
    place = (at_s - steps_s[0]) / QUIET_STEP_S
    index = min(int(place), len(steps_s) - 2)
    return np.asarray(ohm[index] + (place - index) * (ohm[index + 1] - ohm[index]))


def _scores(found: Sequence[Happening]) -> dict[str, Any]:
    held = [one for one in found if one.held]
    delays = [one.delay_s for one in held if one.delay_s is not None]
    return {
        "events": len(found),
        "felt_before": len(held),
        "seen": len(delays),
        "rate": len(delays) / len(held) if held else None,
        "median_delay_s": median(delays),
        "p95_delay_s": median(delays, 0.95),
        "called_before": sum(one.false for one in held),
    }


def _alarms(holds: Sequence[tuple[float, int, bool]]) -> dict[str, Any]:
    felt = [(hours, called) for hours, called, held in holds if held]
    hours, called = sum(h for h, _ in felt), sum(c for _, c in felt)
    return {
        "holds": len(holds),
        "felt": len(felt),
        "hours": hours,
        "called": called,
        "per_hour": called / hours if hours else None,
        # None in that many hours bounds the rate at three over them (95 %).
        "per_hour_at_most": float(chi2.ppf(0.95, 2 * called + 2) / (2 * hours)) if hours else None,
    }
