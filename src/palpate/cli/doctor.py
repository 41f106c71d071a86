"""`palpate doctor`: is the sensor healthy, and if not, what to check."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import options as option
from palpate.cli.doctor_report import Examined, health_document, print_health
from palpate.cli.output import print_json
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.errors import InputError
from palpate.recording import load_recording
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, Frame
from palpate.sensor.findings import Finding, pixel_name
from palpate.sensor.health import FrameColumns, examine
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.sensor.press_order import PressWatch, order_findings


def doctor(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="Judge a recording instead; it must begin at rest.", metavar="FILE"),
    ] = None,
    duration_s: Annotated[
        float,
        typer.Option(
            "--duration", help="How long at rest to judge by.", min=1.0, metavar="SECONDS"
        ),
    ] = 10.0,
    press: Annotated[
        bool, typer.Option("--press", help="Then press each pixel in turn: finds swapped wires.")
    ] = False,
    layout: option.LayoutOption = None,
    reference_ohm: option.ReferenceOption = None,
    rate_hz: option.RateOption = None,
    baud: option.BaudOption = None,
    as_json: option.JsonOption = False,
) -> None:
    """Find faulty and swapped pixels, losses and a wrong resistor.

    It finds dead, shorted, stuck, noisy, drifting and swapped pixels. Nothing may touch the sensor.
    Exit status 1 if something is wrong.

    Example: palpate doctor --port /dev/ttyACM0 --press
    """
    if recording is not None:
        if rig is not None or port is not None:
            raise InputError("--recording excludes --rig and --port")
        examined = _examine_recording(recording, duration_s=duration_s, press=press)
    else:
        source = open_source(
            rig, port=port, layout=layout, reference_ohm=reference_ohm, rate_hz=rate_hz, baud=baud
        )
        with closing(source):
            examined = _examine_source(source, duration_s=duration_s, press=press)
    if as_json:
        print_json(health_document(examined))
    else:
        print_health(examined)
    if not examined.health.healthy:
        raise typer.Exit(1)


def _examine_source(source: SensorSource, *, duration_s: float, press: bool) -> Examined:
    if press and source.simulated:
        raise InputError("--press needs a hand on a real sensor, or a --recording of presses")
    layout = source.array.layout
    if not source.simulated:
        _say(f"{source.name}: leave the sensor alone for {duration_s:g} s")
    known_ohm = source.rest_ohm()
    source.frames(0.0)  # garbage that came before the first frame is no fault of the link
    before = source.events()
    rest = source.frames(duration_s)
    events = source.events().since(before)
    whole = rest
    also: tuple[Finding, ...] = ()
    if press:
        frames = iter(lambda: source.array.read(timeout_s=FRAME_TIMEOUT_S), None)
        whole, also = _follow_presses(frames, rest=rest, layout=layout, prompt=_prompt)
    health = examine(
        rest,
        layout=layout,
        whole=whole,
        known_ohm=known_ohm,
        asked_hz=source.asked_hz,
        events=events,
        also=also,
    )
    return Examined(name=source.name, simulated=source.simulated, layout=layout, health=health)


def _examine_recording(path: Path, *, duration_s: float, press: bool) -> Examined:
    """Judge pixels by the first seconds of a recording, the link by all of it."""
    loaded = load_recording(path)
    layout = loaded.info.layout
    if not len(loaded.time_s):
        raise InputError(f"{path}: no frames to judge")
    if len(set(loaded.oversampling.tolist())) > 1:
        raise InputError(f"{path}: the oversampling changes within it; judge a part without that")
    whole = FrameColumns(
        time_s=loaded.time_s,
        sequence=loaded.sequence,
        counts=loaded.counts,
        oversampling=int(loaded.oversampling[0]),
    )
    rest = whole.first(duration_s)
    also: tuple[Finding, ...] = ()
    if press:
        after = whole.frames()[len(rest.time_s) :]
        _, also = _follow_presses(iter(after), rest=rest, layout=layout, prompt=lambda _: None)
    health = examine(rest, layout=layout, whole=whole, also=also)
    simulated = loaded.info.origin != "hardware"
    return Examined(name=path.name, simulated=simulated, layout=layout, health=health)


def _follow_presses(
    frames: Iterator[Frame],
    *,
    rest: FrameColumns,
    layout: ArrayLayout,
    prompt: Callable[[str], None],
) -> tuple[FrameColumns, tuple[Finding, ...]]:
    """Follow one press after the other; return rest and presses together, and findings."""
    watch, asked, taken = PressWatch(rest.rest_ohm(layout=layout)), None, rest.frames()
    for frame in frames:
        if watch.expected is not None and watch.expected != asked:
            asked = watch.expected
            prompt(f"press pixel {pixel_name(*asked)} (finger {layout.finger_of_row[asked[0]]})")
        ohm = pixel_resistance_ohm(frame.counts, layout=layout, oversampling=frame.oversampling)
        watch.see(frame.time_s, ohm)
        taken.append(frame)
        if watch.done:
            break
    watch.give_up()
    return FrameColumns.of(taken), tuple(order_findings(watch.presses, layout=layout))


def _prompt(text: str) -> None:
    _say(f"{text}, hold it for a moment, let go")


def _say(text: str) -> None:
    print(text, file=sys.stderr)
