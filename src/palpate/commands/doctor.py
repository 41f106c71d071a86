"""`palpate doctor`: is the sensor healthy, and if not, what to check."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands import options as option
from palpate.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from palpate.commands.doctor_report import Examined
    from palpate.commands.sensor_source import SensorSource
    from palpate.sensor.array import ArrayLayout, Frame
    from palpate.sensor.findings import Finding
    from palpate.sensor.health import FrameColumns


def doctor(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    recording: Annotated[
        Path | None, typer.Option(help="Judge a recording instead; it must begin at rest.")
    ] = None,
    duration_s: Annotated[
        float, typer.Option("--duration", help="How long at rest to judge by.", min=1.0)
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
    """Find dead, shorted, stuck, noisy, drifting and swapped pixels, losses and a wrong resistor.

    Nothing may touch the sensor. Exit status 1 if something is wrong.

    Example: palpate doctor --port /dev/ttyACM0 --press
    """
    from palpate.commands.doctor_report import as_document, print_health
    from palpate.commands.sensor_source import open_source

    if recording is not None:
        if rig is not None or port is not None:
            raise InputError("--recording excludes --rig and --port")
        examined = _of_recording(recording, duration_s=duration_s, press=press)
    else:
        source = open_source(
            rig=rig,
            port=port,
            layout=layout,
            reference_ohm=reference_ohm,
            rate_hz=rate_hz,
            baud=baud,
        )
        with closing(source):
            examined = _live(source, duration_s=duration_s, press=press)
    if as_json:
        print(json.dumps(as_document(examined), indent=1, allow_nan=False))
    else:
        print_health(examined)
    if not examined.health.healthy:
        raise typer.Exit(1)


def _live(source: SensorSource, *, duration_s: float, press: bool) -> Examined:
    from palpate.commands.doctor_report import Examined
    from palpate.sensor.array import FRAME_TIMEOUT_S
    from palpate.sensor.health import examine

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
        whole, also = _pressed(frames, rest=rest, layout=layout, prompt=_prompt)
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


def _of_recording(path: Path, *, duration_s: float, press: bool) -> Examined:
    """Judge pixels by the first seconds of a recording, the link by all of it."""
    from palpate.commands.doctor_report import Examined
    from palpate.recording import load_recording
    from palpate.sensor.health import FrameColumns, examine

    held = load_recording(path)
    layout = held.info.layout
    if not len(held.time_s):
        raise InputError(f"{path}: no frames to judge")
    if len(set(held.oversampling.tolist())) > 1:
        raise InputError(f"{path}: the oversampling changes within it; judge a part without that")
    whole = FrameColumns(
        time_s=held.time_s,
        sequence=held.sequence,
        counts=held.counts,
        oversampling=int(held.oversampling[0]),
    )
    rest = whole.first(duration_s)
    also: tuple[Finding, ...] = ()
    if press:
        after = whole.frames()[len(rest.time_s) :]
        _, also = _pressed(iter(after), rest=rest, layout=layout, prompt=lambda _: None)
    health = examine(rest, layout=layout, whole=whole, also=also)
    simulated = held.info.origin != "hardware"
    return Examined(name=path.name, simulated=simulated, layout=layout, health=health)


def _pressed(
    frames: Iterator[Frame],
    *,
    rest: FrameColumns,
    layout: ArrayLayout,
    prompt: Callable[[str], None],
) -> tuple[FrameColumns, tuple[Finding, ...]]:
    """Follow one press after the other; return rest and presses together, and findings."""
    from palpate.sensor.findings import pixel_name
    from palpate.sensor.health import FrameColumns
    from palpate.sensor.pixel_resistance import pixel_resistance_ohm
    from palpate.sensor.press_order import PressWatch, order_findings

    rest_ohm = rest.rest_ohm(layout=layout)
    watch, asked, taken = PressWatch(rest_ohm), None, rest.frames()
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
