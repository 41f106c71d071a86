"""Health check of a sensor: findings from recorded frames, without I/O.

The check of the pixels uses frames at rest, and the check of the link uses all frames. The checks
of the divider use the resistances under load, or an assumed range without load.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, InputError
from palpate.sensor.array import ArrayLayout, LinkCounters
from palpate.sensor.divider_leg import find_wrong_leg
from palpate.sensor.findings import Finding, Severity
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.health_pixels import (
    PixelReadings,
    group_pixels,
    judge_pixels,
    measure_pixels,
)
from palpate.sensor.reference_resistor import ResistorFit, fit_reference
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import relative_change_percent

#: Minimum number of frames for an estimate of the noise.
MIN_FRAMES = 30
#: Without load, resistance under load is assumed to be a twentieth of the rest value. Real Velostat
#: under a robot's indenter fell 9-fold at 3 N and 32-fold at 10 N (medians over 30 recordings).
#: An unsuitable resistor is a fault only with a measured range.
_ASSUMED_FALL = 20.0
#: Minimum fall that counts as a range measured under load; half of the assumed fall.
_LOADED_FALL = 10.0

#: Below this fraction of the requested rate the board is delayed; a resonator's error is 0.5 %.
_SLOW_FRACTION = 0.95
#: Losses above this percentage are a fault, smaller losses are advice.
_LOST_PERCENT = 0.1
#: Limit of the jitter, percent of the frame period.
_JITTER_PERCENT = 10.0
#: Tolerance of a ceramic resonator (the Mega's: 0.5 %).
_DRIFT_PPM = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReadings:
    """Rate, losses and jitter of a sequence of frames."""

    #: Received frames, and frames missing from the numbering.
    frames: int
    lost: int
    #: Time from the first frame to the last.
    duration_s: float
    #: Frames scanned per second, including lost frames.
    rate_hz: float
    #: 95th percentile of the deviation of the frame intervals from the period, percent of it.
    jitter_percent: float
    #: Counters of the link.
    counters: LinkCounters


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """The measurements of a health check, and its findings."""

    #: Rest value, noise, drift and resolution of each pixel.
    pixels: PixelReadings
    #: Rate, losses, jitter.
    link: LinkReadings
    #: Check of the reference resistor; None if no pixel works.
    resistor: ResistorFit | None
    #: Whether the resistance range of `resistor` was measured under load.
    range_measured: bool
    #: Findings, with faults first.
    findings: tuple[Finding, ...]

    @property
    def is_healthy(self) -> bool:
        """Whether there are no faults."""
        return all(finding.severity is not Severity.FAULT for finding in self.findings)


def check_health(
    rest: FrameColumns,
    *,
    layout: ArrayLayout,
    all_frames: FrameColumns | None = None,
    known_ohm: ArrayLike | None = None,
    requested_hz: float | None = None,
    counters: LinkCounters | None = None,
    extra_findings: tuple[Finding, ...] = (),
) -> Health:
    """Check the pixels, the reference resistor and the link of a sensor.

    `rest`: frames of several seconds without contact; at least 30 frames.
    `all_frames`: all frames, including those under load, which show the losses and the working
        range; by default `rest`.
    `known_ohm`, shape (rows, cols): rest values of the calibration.
    `requested_hz`: frame rate set on the board.
    `counters`: counters of the link.
    `extra_findings`: findings of other checks (`palpate.sensor.press_order`).
    Raises `InputError` if there are too few frames or the frames do not fit the layout.

    A pixel with no current is open:

    >>> rng = np.random.default_rng(1)
    >>> counts = np.rint(rng.normal(300, 0.6, (100, 2, 2))).astype(np.int32)
    >>> counts[:, 0, 1] = 0
    >>> frames = FrameColumns(time_s=np.arange(100) / 15, sequence=np.arange(100), counts=counts)
    >>> pair = ArrayLayout(name="pair", rows=2, cols=2, finger_of_row=(0, 1))
    >>> health = check_health(frames, layout=pair)
    >>> health.is_healthy, [(found.code, found.where) for found in health.findings]
    (False, [('open', 'R0 C1')])
    """
    all_frames = rest if all_frames is None else all_frames
    _check_frames(rest, layout=layout)
    mean_counts = rest.mean_counts
    known = None if known_ohm is None else np.asarray(known_ohm, dtype=float)
    pixels = measure_pixels(mean_counts, layout=layout)
    findings: list[Finding] = []
    # Only the most severe fault of a pixel is reported. Only pixels without faults enter the
    # checks of the whole sensor.
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
    findings += _check_rest(np.where(sound, rest.ohm(layout=layout), np.nan), known_ohm=known)
    resistor, measured = _fit_resistor(
        pixels.rest_ohm[sound], all_frames, sound=sound, layout=layout
    )
    change = relative_change_percent(
        all_frames.ohm(layout=layout)[:, sound], rest_ohm=pixels.rest_ohm[sound]
    )
    leg = find_wrong_leg(change, fit=resistor, layout=layout)
    if leg is not None:
        findings.insert(0, leg)
    is_known = leg is None or leg.severity is Severity.ADVICE
    if is_known and resistor is not None and not resistor.is_adequate:
        findings.append(_resistor_finding(resistor, measured=measured, layout=layout))
    link = _measure_link(all_frames, counters=counters or LinkCounters())
    findings += [*extra_findings, *_link_findings(link, requested_hz=requested_hz)]
    return Health(
        pixels=pixels,
        link=link,
        resistor=resistor,
        range_measured=measured,
        findings=tuple(sorted(findings, key=lambda finding: finding.severity is Severity.ADVICE)),
    )


def _check_frames(frames: FrameColumns, *, layout: ArrayLayout) -> None:
    shape = (layout.rows, layout.cols)
    if frames.counts.shape[1:] != shape:
        raise InputError(f"frames of {frames.counts.shape[1:]} pixels don't fit layout {shape}")
    if len(frames.counts) < MIN_FRAMES:
        raise InputError(
            f"{len(frames.counts)} frames are too few to check a sensor (at least "
            f"{MIN_FRAMES}); give a longer --duration"
        )


def _check_rest(ohm: FloatArray, *, known_ohm: FloatArray | None) -> list[Finding]:
    """Report frames that were not recorded at rest; pixels with NaN are ignored."""
    if np.isnan(ohm).all():
        return []
    try:
        rest_baseline(ohm, known_ohm=known_ohm)
    except CalibrationError as error:
        reason = str(error).partition(";")[0]
        return [Finding("unrest", reason, "sensor")]
    return []


def _fit_resistor(
    rest_ohm: FloatArray, frames: FrameColumns, *, sound: NDArray[np.bool_], layout: ArrayLayout
) -> tuple[ResistorFit | None, bool]:
    """Check the reference resistor; also return whether the range was measured under load."""
    if not rest_ohm.size:
        return None, False
    high = float(np.median(rest_ohm))
    ohm = frames.ohm(layout=layout)[:, sound]
    # A quantile instead of the minimum, so that single spikes do not define the range.
    lowest = float(np.quantile(ohm.min(axis=1), 0.005))
    measured = lowest < high / _LOADED_FALL
    step_ohm = layout.divider.reference_ohm / layout.divider.full_scale
    low = max(lowest, step_ohm) if measured else high / _ASSUMED_FALL
    return fit_reference(low_ohm=low, high_ohm=high, divider=layout.divider), measured


def _resistor_finding(fit: ResistorFit, *, measured: bool, layout: ArrayLayout) -> Finding:
    source = "measured" if measured else "assumed from the rest value"
    return Finding(
        "resistor",
        f"one count is up to {fit.step_percent:.1f} % of the resistance in the range "
        f"{fit.low_ohm:.0f} to {fit.high_ohm:.0f} ohm ({source}); with {fit.recommended_ohm:g} ohm "
        f"it would be {fit.recommended_step_percent:.1f} %",
        f"{layout.divider.reference_ohm:g} ohm",
        _choose_severity(measured),
    )


def _measure_link(frames: FrameColumns, *, counters: LinkCounters) -> LinkReadings:
    """Measure the rate, losses and jitter of at least two frames."""
    time_s, sequence = frames.time_s, frames.sequence
    span_s, numbers = float(time_s[-1] - time_s[0]), int(sequence[-1] - sequence[0])
    steps, intervals_s = np.maximum(np.diff(sequence), 1), np.diff(time_s)
    period_s = float(np.median(intervals_s / steps))
    deviation = np.abs(intervals_s - steps * period_s) / period_s if period_s > 0 else np.zeros(1)
    return LinkReadings(
        frames=len(time_s),
        lost=int((steps - 1).sum()),
        duration_s=span_s,
        rate_hz=numbers / span_s if span_s > 0 else 0.0,
        jitter_percent=float(100.0 * np.quantile(deviation, 0.95)),
        counters=counters,
    )


def _link_findings(link: LinkReadings, *, requested_hz: float | None) -> Iterator[Finding]:
    """Yield the findings about the link."""
    if requested_hz is not None and link.rate_hz < _SLOW_FRACTION * requested_hz:
        yield Finding("slow", f"{link.rate_hz:.1f} frames/s instead of {requested_hz:g}")
    lost_percent = 100.0 * link.lost / (link.frames + link.lost)
    if link.lost:
        text = f"{link.lost} of {link.frames + link.lost} frames lost ({lost_percent:.2g} %)"
        yield Finding("lost", text, severity=_choose_severity(lost_percent > _LOST_PERCENT))
    counters = link.counters
    if counters.corrupt:
        text = f"{counters.corrupt} packets or lines rejected as corrupt"
        bad = 100.0 * counters.corrupt / link.frames > _LOST_PERCENT
        yield Finding("corrupt", text, severity=_choose_severity(bad))
    if counters.late:
        yield Finding(
            "late",
            f"{counters.late} frames read late: the computer stalled",
            severity=Severity.ADVICE,
        )
    if link.jitter_percent > _JITTER_PERCENT:
        text = f"5 % of the frame intervals deviate by {link.jitter_percent:.0f} % or more"
        yield Finding("jitter", text, severity=Severity.ADVICE)
    if counters.drift_ppm is not None and abs(counters.drift_ppm) > _DRIFT_PPM:
        text = f"the clocks of board and computer differ by {counters.drift_ppm:+.0f} ppm"
        yield Finding("clock", text)
    if restarts := counters.restarts + counters.reconnects:
        yield Finding("restarted", f"the stream was restarted {restarts} times")


def _choose_severity(bad: bool) -> Severity:
    return Severity.FAULT if bad else Severity.ADVICE
