"""`palpate record FILE`: record the frames of a board or a whole rig."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli import options as option
from palpate.cli.options import opt
from palpate.cli.output import print_message
from palpate.clock import RealClock
from palpate.errors import InputError
from palpate.recording import LoadCells, RecordingWriter
from palpate.recording.writer import record_frames
from palpate.rig import Rig
from palpate.rig.recorded import recording_info
from palpate.rig.sensor_only import SensorRig, open_rig_or_sensor
from palpate.sensor.array import PressureArray, get_link_counters
from palpate.sensor.board_array import open_board
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import NO_READING
from palpate.stop_signals import watch_stop_signals


def record(
    file: Annotated[Path, typer.Argument(help="The new recording.")] = Path("recording.mcap"),
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    duration_s: Annotated[
        float | None, opt("--duration SECONDS", "Recording time. [default: until Ctrl-C]")
    ] = None,
    seed: option.SeedOption = 0,
) -> None:
    """Record a board, or a rig with its gripper.

    The file is readable during the recording. Ctrl-C, SIGTERM or a closed terminal ends the
    recording with a complete file and exit status 130.

    Example: palpate record apple.mcap --port /dev/ttyACM0 --duration 30
    """
    if file.suffix != ".mcap":
        raise InputError(f"{file}: recordings must end in .mcap; `palpate export` writes tables")
    if duration_s is not None and not duration_s > 0:
        raise InputError(f"--duration {duration_s:g}: must be above 0")
    rig = option.resolve_rig(rig, port)
    with ExitStack() as stack:
        opened = _open_rig(rig, port=port, seed=seed, endless=duration_s is None)
        stack.callback(opened.close)
        array, gripper, info = opened.array, opened.gripper, recording_info(opened, seed=seed)
        name = f"{opened.name} (simulated)" if opened.is_simulated else opened.name
        # Installed before the file is opened, so that a signal can't truncate its start or end.
        stopped = stack.enter_context(watch_stop_signals())
        writer = stack.enter_context(RecordingWriter(file, info=info))
        print_message(f"recording {name} to {file}; Ctrl-C ends it")
        record_frames(
            array,
            writer=writer,
            clock=opened.clock,
            duration_s=math.inf if duration_s is None else duration_s,
            load_cells=_load_cell_reader(array),
            gripper=lambda: None if gripper is None else gripper.state(),
            stopped=stopped,
            report=print_message,
        )
    count = get_link_counters(array)
    print_message(
        f"{file}: recorded"
        if count is None
        else f"{file}: {count.frames} frames, {count.lost} lost, {count.corrupt} corrupt, "
        f"{count.late} late, {count.reconnects} reconnects"
    )
    if stopped():
        raise KeyboardInterrupt


def _open_rig(name: str | None, *, port: str | None, seed: int, endless: bool) -> Rig | SensorRig:
    """Open a rig with its optional gripper, or the board on a port."""
    if name is None:
        board = open_board(port=port)
        return SensorRig(name=board.name, array=board, clock=RealClock(), calibration=None)
    rig = open_rig_or_sensor(name, seed=seed)
    if rig.is_simulated and endless:
        rig.close()
        raise InputError(f"--rig {name} is simulated and would never end; give a --duration")
    return rig


def _load_cell_reader(array: PressureArray) -> Callable[[], LoadCells | None]:
    """Return a function that reads each new pair of load-cell readings once."""
    seen: list[int] = []

    def read() -> LoadCells | None:
        if not isinstance(array, SerialArray):
            return None
        cells = array.load_cells
        samples = [cell.sample for cell in cells]
        if samples == seen or all(cell.raw == NO_READING for cell in cells):
            return None
        seen[:] = samples
        return LoadCells(time_s=array.newest_s, raw=tuple(cell.raw for cell in cells))

    return read
