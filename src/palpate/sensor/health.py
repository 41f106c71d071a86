"""The health of a sensor: a stretch of frames in, findings out. No I/O.

Pixels are judged by a stretch at rest, the link by all frames, the reference resistor by the range
of resistances seen under load, or by an assumed one where there was no load.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, InputError
from palpate.sensor.array import ArrayLayout, Frame, LinkCounters
from palpate.sensor.findings import Finding, Severity
from palpate.sensor.health_pixels import (
    PixelReadings,
    group_pixels,
    judge_pixels,
    measure_pixels,
)
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.sensor.reference_resistor import ResistorFit, fit_reference
from palpate.signal.relative import rest_baseline

#: Fewer frames show nothing about noise.
FEWEST_FRAMES = 30
#: Where no load was seen, pixels are taken to fall to a twentieth of their rest value: real
#: Velostat under a robot's indenter fell 9-fold at 3 N and 32-fold at 10 N (medians over 30
#: recordings). Only a measured range makes a fault of a resistor.
_ASSUMED_FALL = 20.0
#: Deep enough to show the range under load; half of what the assumption takes.
_LOADED_FALL = 10.0

#: Below this share of the asked rate something delays the board; a resonator has an error of 0.5 %.
_SLOW_SHARE = 0.95
#: Losses above this are a fault, fewer are worth a word.
_LOST_PERCENT = 0.1
#: Spread of the frame period: half of the settle time of a fast filter over ten frames.
_JITTER_PERCENT = 10.0
#: What a ceramic resonator may be off (the Mega's: 0.5 %).
_DRIFT_PPM = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameColumns:
    """Frames in columns."""

    #: Shape (frames,). When each was scanned.
    time_s: FloatArray
    #: Shape (frames,). Their numbers, without wrap.
    sequence: NDArray[np.int64]
    #: Shape (frames, rows, cols). Sums of `oversampling` conversions.
    counts: NDArray[np.int32]
    #: Conversions summed per pixel, the same in all frames.
    oversampling: int = 1

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> FrameColumns:
        """Return frames of one oversampling as columns."""
        return cls(
            time_s=np.array([frame.time_s for frame in frames]),
            sequence=np.array([frame.sequence for frame in frames], dtype=np.int64),
            counts=np.array([frame.counts for frame in frames]),
            oversampling=frames[-1].oversampling,
        )

    def frames(self) -> list[Frame]:
        """Return the frames one by one."""
        return [
            Frame(
                time_s=float(time_s),
                sequence=int(number),
                counts=counts,
                oversampling=self.oversampling,
            )
            for time_s, number, counts in zip(self.time_s, self.sequence, self.counts, strict=True)
        ]

    def first(self, duration_s: float) -> FrameColumns:
        """Return the frames of the first `duration_s` seconds."""
        count = int(np.searchsorted(self.time_s, self.time_s[0] + duration_s, side="right"))
        return replace(
            self,
            time_s=self.time_s[:count],
            sequence=self.sequence[:count],
            counts=self.counts[:count],
        )

    @property
    def mean_counts(self) -> FloatArray:
        """Counts per conversion, shape (frames, rows, cols)."""
        return np.asarray(self.counts / float(self.oversampling))

    def ohm(self, *, layout: ArrayLayout) -> FloatArray:
        """Return resistances, shape (frames, rows, cols)."""
        return pixel_resistance_ohm(self.counts, layout=layout, oversampling=self.oversampling)

    def rest_ohm(self, *, layout: ArrayLayout) -> FloatArray:
        """Return the median resistance of each pixel: inf where open, 0 where short."""
        return measure_pixels(self.mean_counts, layout=layout).rest_ohm


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReadings:
    """Times and losses of the frames of a stretch."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """The measurements of a health check, and its findings."""

    #: Rest value, noise, drift and resolution of each pixel.
    pixels: PixelReadings
    #: Rate, losses, jitter.
    link: LinkReadings
    #: None where no pixel reads.
    resistor: ResistorFit | None
    #: Whether the range behind `resistor` was seen under load.
    range_measured: bool
    #: Faults first.
    findings: tuple[Finding, ...]

    @property
    def healthy(self) -> bool:
        """Whether no fault was found."""
        return all(finding.severity is not Severity.FAULT for finding in self.findings)


def examine(
    rest: FrameColumns,
    *,
    layout: ArrayLayout,
    whole: FrameColumns | None = None,
    known_ohm: ArrayLike | None = None,
    asked_hz: float | None = None,
    events: LinkCounters | None = None,
    also: tuple[Finding, ...] = (),
) -> Health:
    """Judge a sensor.

    `rest`: some seconds in which nothing touches the sensor; at least 30 frames.
    `whole`: all frames, under load too: for losses and for the working range; by default `rest`.
    `known_ohm`, shape (rows, cols): rest values of the calibration.
    `asked_hz`: rate that the board was set to.
    `also`: found by other means (`palpate.sensor.press_order`).
    Raises `InputError` if there are too few frames, or they don't fit the layout.

    A pixel at 512 counts that never reads anything is open:

    >>> rng = np.random.default_rng(1)
    >>> counts = np.rint(rng.normal(300, 0.6, (100, 2, 2))).astype(np.int32)
    >>> counts[:, 0, 1] = 0
    >>> frames = FrameColumns(time_s=np.arange(100) / 15, sequence=np.arange(100), counts=counts)
    >>> pair = ArrayLayout(name="pair", rows=2, cols=2, finger_of_row=(0, 1))
    >>> health = examine(frames, layout=pair)
    >>> health.healthy, [(found.code, found.where) for found in health.findings]
    (False, [('open', 'R0 C1')])
    """
    whole = rest if whole is None else whole
    _refuse_unfit(rest, layout=layout)
    mean_counts = rest.mean_counts
    known = None if known_ohm is None else np.asarray(known_ohm, dtype=float)
    pixels = measure_pixels(mean_counts, layout=layout)
    findings: list[Finding] = []
    # Of several faults of one pixel only the gravest is named; the sound ones show the whole.
    sound = np.ones((layout.rows, layout.cols), dtype=np.bool_)
    for code, mask, text, values in judge_pixels(
        mean_counts,
        steps_per_count=rest.oversampling,
        readings=pixels,
        layout=layout,
        known_ohm=known,
    ):
        for where, group in group_pixels(mask & sound):
            number = f"{float(np.median(values[group])):.3g}"
            findings.append(Finding(code, text.format(number), where))
        sound &= ~mask
    findings += _find_unrest(np.where(sound, rest.ohm(layout=layout), np.nan), known_ohm=known)
    resistor, measured = _fit_resistor(pixels.rest_ohm[sound], whole, sound=sound, layout=layout)
    if resistor is not None and not resistor.fits:
        findings.append(_resistor_finding(resistor, measured=measured, layout=layout))
    link = _measure_link(whole.time_s, sequence=whole.sequence, events=events or LinkCounters())
    findings += [*also, *_link_findings(link, asked_hz=asked_hz)]
    return Health(
        pixels=pixels,
        link=link,
        resistor=resistor,
        range_measured=measured,
        findings=tuple(sorted(findings, key=lambda finding: finding.severity is Severity.ADVICE)),
    )


def _refuse_unfit(stretch: FrameColumns, *, layout: ArrayLayout) -> None:
    shape = (layout.rows, layout.cols)
    if stretch.counts.shape[1:] != shape:
        raise InputError(f"frames of {stretch.counts.shape[1:]} pixels don't fit layout {shape}")
    if len(stretch.counts) < FEWEST_FRAMES:
        raise InputError(
            f"{len(stretch.counts)} frames are too few to judge a sensor (at least "
            f"{FEWEST_FRAMES}); give a longer --duration"
        )


def _find_unrest(ohm: FloatArray, *, known_ohm: FloatArray | None) -> list[Finding]:
    """Report a stretch that is not at rest; NaN marks pixels that don't count."""
    if np.isnan(ohm).all(axis=0).all():
        return []
    try:
        rest_baseline(ohm, known_ohm=known_ohm)
    except CalibrationError as error:
        reason = str(error).partition(";")[0]
        return [Finding("unrest", reason, "sensor")]
    return []


def _fit_resistor(
    rest_ohm: FloatArray, whole: FrameColumns, *, sound: NDArray[np.bool_], layout: ArrayLayout
) -> tuple[ResistorFit | None, bool]:
    """Compare the reference resistor with the range of the sound pixels."""
    if not rest_ohm.size:
        return None, False
    high = float(np.median(rest_ohm))
    seen = whole.ohm(layout=layout)[:, sound]
    # The hardest half percent of readings: a range that a few spikes don't set.
    lowest = float(np.quantile(seen.min(axis=1), 0.005))
    measured = lowest < high / _LOADED_FALL
    step_ohm = layout.divider.reference_ohm / layout.divider.full_scale
    low = max(lowest, step_ohm) if measured else high / _ASSUMED_FALL
    return fit_reference(low_ohm=low, high_ohm=high, divider=layout.divider), measured


def _resistor_finding(fit: ResistorFit, *, measured: bool, layout: ArrayLayout) -> Finding:
    how = "measured" if measured else "assumed from the rest value"
    return Finding(
        "resistor",
        f"one count is {fit.step_percent:.1f} % at an end of the range {fit.low_ohm:.0f} to "
        f"{fit.high_ohm:.0f} ohm ({how}); {fit.recommended_ohm:g} ohm would make it "
        f"{fit.recommended_step_percent:.1f} %",
        f"{layout.divider.reference_ohm:g} ohm",
        _severity_of(measured),
    )


def _measure_link(
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


def _link_findings(link: LinkReadings, *, asked_hz: float | None) -> Iterator[Finding]:
    """Yield the findings on the link.

    `asked_hz`: the rate that the board was set to, where known.
    """
    if asked_hz is not None and link.rate_hz < _SLOW_SHARE * asked_hz:
        yield Finding("slow", f"{link.rate_hz:.1f} frames/s instead of {asked_hz:g}")
    lost_percent = 100.0 * link.lost / (link.frames + link.lost)
    if link.lost:
        text = f"{link.lost} of {link.frames + link.lost} frames lost ({lost_percent:.2g} %)"
        yield Finding("lost", text, severity=_severity_of(lost_percent > _LOST_PERCENT))
    events = link.events
    if events.corrupt:
        text = f"{events.corrupt} packets or lines rejected as corrupt"
        bad = 100.0 * events.corrupt / link.frames > _LOST_PERCENT
        yield Finding("corrupt", text, severity=_severity_of(bad))
    if events.late:
        yield Finding(
            "late",
            f"{events.late} frames read late: the computer stalled",
            severity=Severity.ADVICE,
        )
    if link.jitter_percent > _JITTER_PERCENT:
        text = f"the time between frames is off by {link.jitter_percent:.0f} % of the period"
        yield Finding("jitter", text, severity=Severity.ADVICE)
    if events.drift_ppm is not None and abs(events.drift_ppm) > _DRIFT_PPM:
        yield Finding("clock", f"board and computer drift apart by {events.drift_ppm:+.0f} ppm")
    if restarts := events.restarts + events.reconnects:
        yield Finding("restarted", f"the stream began again {restarts} times")


def _severity_of(bad: bool) -> Severity:
    return Severity.FAULT if bad else Severity.ADVICE
