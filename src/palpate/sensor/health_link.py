"""Faults of the link, from times and numbers of frames and the link's own counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import LinkCounters
from palpate.sensor.findings import Finding, Severity

#: Below this share of the asked rate something delays the board; a resonator has an error of 0.5 %.
_SLOW_SHARE = 0.95
#: Losses above this are a fault, fewer are worth a word.
_LOST_PERCENT = 0.1
#: Spread of the frame period: half of the settle time of a fast filter over ten frames.
_JITTER_PERCENT = 10.0
#: What a ceramic resonator may be off (the Mega's: 0.5 %).
_DRIFT_PPM = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReadings:
    """The stretch as frames in time."""

    #: Received, and missing in the numbering.
    frames: int
    lost: int
    #: From the first frame to the last.
    duration_s: float
    #: Frames scanned per second, lost ones included.
    rate_hz: float
    #: The interval between frames that 5 % of the intervals are further off than, percent of the
    #: period.
    jitter_percent: float
    #: What the link counted.
    events: LinkCounters


def measure_link(
    time_s: FloatArray, *, sequence: NDArray[np.int64], events: LinkCounters
) -> LinkReadings:
    """Measure rate, losses and jitter of frames.

    `time_s`, shape (frames,): when each was scanned; at least two frames.
    `sequence`, shape (frames,): their numbers, without wrap.
    """
    span_s, numbers = float(time_s[-1] - time_s[0]), int(sequence[-1] - sequence[0])
    steps, intervals_s = np.maximum(np.diff(sequence), 1), np.diff(time_s)
    period_s = float(np.median(intervals_s / steps))
    off = np.abs(intervals_s - steps * period_s) / period_s if period_s > 0 else np.zeros(1)
    return LinkReadings(
        frames=len(time_s),
        lost=int((steps - 1).sum()),
        duration_s=span_s,
        rate_hz=numbers / span_s if span_s > 0 else 0.0,
        jitter_percent=float(100.0 * np.quantile(off, 0.95)),
        events=events,
    )


def link_findings(link: LinkReadings, *, asked_hz: float | None) -> Iterator[Finding]:
    """Yield what is wrong with the link.

    `asked_hz`: the rate that the board was set to, where known.
    """
    if asked_hz is not None and link.rate_hz < _SLOW_SHARE * asked_hz:
        yield _fault("slow", f"{link.rate_hz:.1f} frames/s instead of {asked_hz:g}")
    lost_percent = 100.0 * link.lost / (link.frames + link.lost)
    if link.lost:
        text = f"{link.lost} of {link.frames + link.lost} frames lost ({lost_percent:.2g} %)"
        yield _fault("lost", text) if lost_percent > _LOST_PERCENT else _advice("lost", text)
    events = link.events
    if events.corrupt:
        text = f"{events.corrupt} packets or lines rejected as corrupt"
        bad = 100.0 * events.corrupt / link.frames > _LOST_PERCENT
        yield _fault("corrupt", text) if bad else _advice("corrupt", text)
    if events.late:
        yield _advice("late", f"{events.late} frames read late: the computer stalled")
    if link.jitter_percent > _JITTER_PERCENT:
        text = f"the time between frames is off by {link.jitter_percent:.0f} % of the period"
        yield _advice("jitter", text)
    if events.drift_ppm is not None and abs(events.drift_ppm) > _DRIFT_PPM:
        yield _fault("clock", f"board and computer drift apart by {events.drift_ppm:+.0f} ppm")
    if restarts := events.restarts + events.reconnects:
        yield _fault("restarted", f"the stream began again {restarts} times")


def _fault(code: str, text: str) -> Finding:
    return Finding(code=code, severity=Severity.FAULT, where="link", text=text)


def _advice(code: str, text: str) -> Finding:
    return Finding(code=code, severity=Severity.ADVICE, where="link", text=text)
