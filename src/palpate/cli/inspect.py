"""`palpate inspect FILE`: content, completeness and recovery of a recording."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from palpate.cli import options as option
from palpate.cli.options import JsonOption, opt
from palpate.cli.output import print_json, print_message
from palpate.errors import InputError
from palpate.files import check_new
from palpate.plots.recording import recording_figure
from palpate.plots.style import check_plot, save_figure
from palpate.recording import RecordingReader, load_recording
from palpate.recording import recover as recover_recording
from palpate.recording.reader import summarise_recording


def inspect(
    file: option.RecordingArgument,
    as_json: JsonOption = False,
    plot: option.PlotOption = None,
    recover: Annotated[
        Path | None,
        opt(
            "--recover FILE",
            "Write all intact messages to a new, complete recording, and show it. The name of "
            "the recording itself replaces the recording.",
        ),
    ] = None,
) -> None:
    """Show the contents of a recording and whether the file is complete.

    palpate can read an interrupted recording. Other tools may require a complete file, which
    --recover writes.

    Example: palpate inspect run.mcap --recover run-whole.mcap
    """
    check_plot(plot)
    if recover is not None:
        _recover(file, recover)
        file = recover
    if plot is not None:
        recording = load_recording(file)
        if recording.time_s.size == 0:
            raise InputError(f"{file}: no frames to plot")
        save_figure(recording_figure(recording, title=file.name), plot)
    with RecordingReader(file) as reader:
        summary = summarise_recording(reader)
        info, state = reader.info, reader.state
    document: dict[str, Any] = {
        "path": str(file),
        "bytes": file.stat().st_size,
        "origin": info.origin,
        "rig": info.rig,
        "layout": asdict(info.layout),
        "firmware_version": info.firmware_version,
        "seed": info.seed,
        "versions": dict(info.versions),
        "calibrated": info.calibration is not None,
        **asdict(summary),
        "intact": state.is_intact,
        "condition": state.describe(),
        **asdict(state),
    }
    if as_json:
        print_json(document)
    else:
        print(_recording_text(document))
        if plot is not None:
            print(f"Written: {plot}")


def _recover(file: Path, out: Path) -> None:
    in_place = out.exists() and file.exists() and out.samefile(file)
    if not in_place:
        check_new(out, option="name")
    found = recover_recording(file, out)
    if found.is_intact:
        report = f"{file} was already complete" + ("" if in_place else f"; copied to {out}")
    else:
        report = (
            f"{out}: recovered; lost: {found.damaged_chunks} damaged chunks, "
            f"{found.unread_bytes} unreadable bytes at the end"
        )
        if not found.is_description_checked:
            report += "; its rig, layout and calibration could not be checked"
    print_message(report)


def _recording_text(found: dict[str, Any]) -> str:
    layout = found["layout"]
    simulated = "" if found["origin"] == "hardware" else " (simulated)"
    rate = "" if found["rate_hz"] is None else f" at {found['rate_hz']:.1f} Hz"
    lines = {
        "origin": f"{found['origin']}{simulated}",
        "layout": f"{layout['name']}, {layout['rows']} x {layout['cols']} pixels",
        "rig": found["rig"],
        "firmware": found["firmware_version"],
        "seed": found["seed"],
        "calibration": "in the file" if found["calibrated"] else None,
        "duration": f"{found['duration_s']:.2f} s",
        "frames": f"{found['frames']}{rate}, {found['frames_skipped']} skipped, "
        f"{found['frames_lost']} lost",
        "gripper": f"{found['gripper_states']} states",
        "load cells": found["load_cell_readings"] or None,
        "events": found["events"] or None,
        "file": _condition_text(found),
    }
    return "\n".join(f"{name:<12} {text}" for name, text in lines.items() if text is not None)


def _condition_text(found: dict[str, Any]) -> str:
    condition = found["condition"]
    if found["intact"]:
        return f"complete; {condition}" if condition else "complete"
    return (
        f"{condition}; "
        f"`palpate inspect {found['path']} --recover FILE` writes a complete file for other tools"
    )
