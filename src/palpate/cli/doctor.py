"""`palpate doctor`: faults of a sensor, with remedies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from palpate.cli import options as option
from palpate.cli.options import opt
from palpate.cli.output import finite_or_none, print_card, print_json, print_message
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.errors import InputError
from palpate.recording import load_recording
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, Frame
from palpate.sensor.findings import Finding, Severity, pixel_name
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.health import Health, check_health
from palpate.sensor.press_order import PressMonitor, order_findings
from palpate.sensor.sample import SampleReader
from palpate.sensor.usb_latency import explain_latencies
from palpate.terminal_table import make_console, make_table


def doctor(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    recording: Annotated[
        Path | None, opt("--recording FILE", "Check a recording instead, which must start at rest.")
    ] = None,
    duration_s: Annotated[
        float, opt("--duration SECONDS", "Duration of the check at rest.", min=1.0)
    ] = 10.0,
    press: Annotated[
        bool, opt("--press", "Prompt for a press on each pixel in turn, to find swapped wires.")
    ] = False,
    as_json: option.JsonOption = False,
) -> None:
    """Find faulty or swapped pixels, lost frames and a wrong divider.

    A pixel may be dead, shorted, stuck, noisy or drifting. Nothing may touch the sensor. Exit
    status 1: faults found.

    Example: palpate doctor --port /dev/ttyACM0 --press
    """
    if recording is not None:
        if rig is not None or port is not None:
            raise InputError("--recording can't be combined with --rig or --port")
        examined = _examine_recording(recording, duration_s=duration_s, press=press)
    else:
        with closing(open_source(rig, port=port)) as source:
            examined = _examine_source(source, duration_s=duration_s, press=press)
    if as_json:
        print_json(health_document(examined))
    else:
        print_health(examined)
    if not examined.health.is_healthy:
        raise typer.Exit(1)


def _examine_source(source: SensorSource, *, duration_s: float, press: bool) -> Examined:
    if press and source.simulated:
        raise InputError("--press requires a real sensor, or a --recording of presses")
    layout = source.array.layout
    known_ohm = source.rest_ohm()
    if not source.simulated:
        print_message(f"{source.name}: do not touch the sensor for {duration_s:g} s")
    source.frames(0.0)  # Bytes before the first frame are not link errors.
    before = source.link_counters()
    rest = source.frames(duration_s)
    counters = source.link_counters().count_since(before)
    all_frames = rest
    extra = tuple(
        Finding("latency", text, severity=Severity.ADVICE)
        for text in explain_latencies(source.ports)
    )
    if press:
        frames = iter(lambda: source.array.read(timeout_s=FRAME_TIMEOUT_S), None)
        all_frames, found = _follow_presses(frames, rest=rest, layout=layout, prompt=print_message)
        extra += found
    health = check_health(
        rest,
        layout=layout,
        all_frames=all_frames,
        known_ohm=known_ohm,
        requested_hz=source.requested_rate_hz,
        counters=counters,
        extra_findings=extra,
    )
    return Examined(name=source.name, simulated=source.simulated, layout=layout, health=health)


def _examine_recording(path: Path, *, duration_s: float, press: bool) -> Examined:
    """Check the pixels at the start of a recording, and the link throughout."""
    loaded = load_recording(path)
    layout = loaded.info.layout
    if not len(loaded.time_s):
        raise InputError(f"{path}: no frames to check")
    if len(set(loaded.oversampling.tolist())) > 1:
        raise InputError(
            f"{path}: the oversampling changes during the recording; record with one setting"
        )
    all_frames = FrameColumns(
        time_s=loaded.time_s,
        sequence=loaded.sequence,
        counts=loaded.counts,
        oversampling=int(loaded.oversampling[0]),
    )
    rest = all_frames.select_first(duration_s)
    extra: tuple[Finding, ...] = ()
    if press:
        after = all_frames.to_frames()[len(rest.time_s) :]
        _, extra = _follow_presses(iter(after), rest=rest, layout=layout, prompt=lambda _: None)
    health = check_health(rest, layout=layout, all_frames=all_frames, extra_findings=extra)
    simulated = loaded.info.origin != "hardware"
    return Examined(name=path.name, simulated=simulated, layout=layout, health=health)


def _follow_presses(
    frames: Iterator[Frame],
    *,
    rest: FrameColumns,
    layout: ArrayLayout,
    prompt: Callable[[str], None],
) -> tuple[FrameColumns, tuple[Finding, ...]]:
    """Monitor presses; return the frames at rest and pressed, and the findings."""
    monitor, requested, taken = PressMonitor(rest.rest_ohm(layout=layout)), None, rest.to_frames()
    reader = SampleReader(layout)
    for frame in frames:
        if monitor.next_pixel is not None and monitor.next_pixel != requested:
            requested = monitor.next_pixel
            where = f"pixel {pixel_name(*requested)} (finger {layout.finger_of_row[requested[0]]})"
            prompt(f"press {where}, hold briefly, then release")
        monitor.add_frame(frame.time_s, reader.read(frame).resistance_ohm)
        taken.append(frame)
        if monitor.has_risen:
            # `check_health` reports the leg of the divider; no pixel is silent.
            return FrameColumns.from_frames(taken), ()
        if monitor.is_done:
            break
    monitor.finish()
    return FrameColumns.from_frames(taken), tuple(order_findings(monitor.presses, layout=layout))


_MARKS = {Severity.FAULT: "[bold red]✗[/]", Severity.ADVICE: "[yellow]![/]"}
#: Above this number of pixels, only pixels with findings are listed.
_LISTED_PIXELS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """The health of a sensor, with the source of its frames."""

    name: str
    simulated: bool
    layout: ArrayLayout
    health: Health


def health_document(examined: Examined) -> dict[str, Any]:
    """Return the JSON document."""
    health, layout = examined.health, examined.layout
    link, fit, pixels = health.link, health.resistor, health.pixels
    return {
        "healthy": health.is_healthy,
        "source": examined.name,
        "simulated": examined.simulated,
        "layout": layout.name,
        "findings": [
            {name: getattr(found, name) for name in ("code", "severity", "where", "text", "check")}
            for found in health.findings
        ],
        "pixels": [
            {
                "row": row,
                "col": col,
                "finger": layout.finger_of_row[row],
                "rest_ohm": finite_or_none(float(pixels.rest_ohm[row, col])),
                "noise_percent": finite_or_none(float(pixels.noise_percent[row, col])),
                "drift_percent": finite_or_none(float(pixels.drift_percent[row, col])),
                "count_percent": finite_or_none(float(pixels.count_percent[row, col])),
            }
            for row, col in np.ndindex(layout.rows, layout.cols)
        ],
        "reference_ohm": layout.divider.reference_ohm,
        "recommended_reference_ohm": None if fit is None else fit.recommended_ohm,
        "range_ohm": None if fit is None else [fit.low_ohm, fit.high_ohm],
        "range_measured": health.range_measured,
        "frames": link.frames,
        "frames_lost": link.lost,
        "duration_s": link.duration_s,
        "rate_hz": link.rate_hz,
        "jitter_percent": link.jitter_percent,
        "corrupt": link.counters.corrupt,
        "late": link.counters.late,
        "clock_drift_ppm": link.counters.drift_ppm,
    }


def print_health(examined: Examined) -> None:
    """Print the report on standard output."""
    health = examined.health
    color = "green" if health.is_healthy else "red"
    faults = sum(found.severity is Severity.FAULT for found in health.findings)
    summary = "healthy" if health.is_healthy else f"{faults} fault{'s' * (faults > 1)}"
    console = make_console()
    print_card(
        console,
        Text(summary.capitalize(), style=f"bold {color}"),
        None,
        _pixels(examined),
        None,
        _summary(examined),
        *((None, _findings(health)) if health.findings else ()),
        title=f"[bold]{examined.name}[/], {examined.layout.name}",
        subtitle="[bold yellow]SIMULATED[/]" if examined.simulated else "measured",
        style=color,
    )


def _pixels(examined: Examined) -> Table:
    layout, pixels = examined.layout, examined.health.pixels
    marks = _pixel_marks(examined)
    names = ["pixel", ">finger", ">at rest", ">noise", ">drift", ">one count", *[""] * bool(marks)]
    table = make_table(names)
    for column in table.columns:
        # Numbers are not separated from their units; only the longest heading may wrap.
        column.no_wrap = column.header != "one count"
    for row, col in np.ndindex(layout.rows, layout.cols):
        name = pixel_name(row, col)
        if layout.pixels > _LISTED_PIXELS and name not in marks:
            continue
        table.add_row(
            name,
            str(layout.finger_of_row[row]),
            _ohm_text(float(pixels.rest_ohm[row, col])),
            _percent(float(pixels.noise_percent[row, col])),
            _percent(float(pixels.drift_percent[row, col]), sign="+"),
            _percent(float(pixels.count_percent[row, col])),
            *([f"[bold red]{marks.get(name, '')}[/]"] if marks else []),
        )
    if not table.row_count:
        table.add_row(f"all {layout.pixels} normal")
    return table


def _pixel_marks(examined: Examined) -> dict[str, str]:
    """Return pixel name -> code of the pixel's first finding."""
    return {
        pixel_name(row, col): found.code
        # Reversed, so that a pixel's first finding wins.
        for found in reversed(examined.health.findings)
        for row, col in np.ndindex(examined.layout.rows, examined.layout.cols)
        if found.affects_pixel(row, col)
    }


def _summary(examined: Examined) -> Text:
    health = examined.health
    link, fit = health.link, health.resistor
    parts = [
        f"{link.frames} frames in {link.duration_s:.1f} s",
        f"{link.rate_hz:.1f} Hz",
        f"{link.lost} lost",
        f"{link.counters.corrupt} corrupt",
        f"jitter {link.jitter_percent:.1f} %",
    ]
    if link.counters.drift_ppm is not None:
        parts.append(f"clock {link.counters.drift_ppm:+.0f} ppm")
    lines = "  ·  ".join(parts)
    if fit is not None:
        how = "measured" if health.range_measured else "low end assumed"
        lines += (
            f"\nreference {fit.present_ohm:g} ohm: one count is at most {fit.step_percent:.1f} % "
            f"from {_ohm_text(fit.low_ohm)} to {_ohm_text(fit.high_ohm)} ({how})"
        )
    return Text(lines, style="dim")


def _findings(health: Health) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), show_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(max_width=74)
    for found in health.findings:
        table.add_row(
            _MARKS[found.severity],
            f"[bold]{found.where}[/]",
            f"{found.text} [dim]({found.code})[/]\n{found.check[0].upper()}{found.check[1:]}.",
        )
    return table


def _ohm_text(ohm: float) -> str:
    if math.isinf(ohm):
        return "open"
    if ohm == 0:
        return "short"
    return f"{ohm / 1e3:.2f} kohm" if ohm >= 1e3 else f"{ohm:.0f} ohm"


def _percent(value: float, *, sign: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:{sign}z.2f} %"
