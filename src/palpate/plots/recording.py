"""Overview of a recording: pixels, unfiltered (the paper's Figure 2c), gripper, load, events."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.plots.style import AMBER, BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, new_figure
from palpate.recording import Recording
from palpate.recording.exporting import solve_resistance_ohm
from palpate.sensor.findings import pixel_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER, INK, GREY)
_LINES = ("-", "--", ":")
#: Maximum number of event labels, and of pixels in a legend.
_MOST_EVENTS = 12
_MOST_PIXELS = 32


def recording_figure(recording: Recording, *, title: str) -> Figure:
    """Draw resistances, and below the gripper and the load cells.

    Parameters
    ----------
    recording : Recording
        Recording with at least one frame.
    title : str
        Title; the origin of the frames is appended.
    """
    gripper, cells = recording.gripper.time_s.size > 0, bool(recording.load_cells)
    rows = 1 + gripper + cells
    with new_figure(rows=rows, width_in=8.0, height_in=3.2 + 1.7 * (rows - 1)) as (figure, axes):
        panels = list(axes[:, 0])
        start_s = float(recording.time_s[0])
        _draw_pixels(panels[0], recording, start_s)
        if gripper:
            _draw_gripper(panels[1], recording, start_s)
        if cells:
            _draw_cells(panels[-1], recording, start_s)
        # If the sensor stopped responding, the last event is after the last frame.
        end_s = max(float(recording.time_s[-1]), *(e.time_s for e in recording.events), start_s)
        for panel in panels:
            panel.set_xlim(0.0, max(end_s - start_s, 0.1))
        _draw_events(panels, recording, start_s)
        panels[-1].set_xlabel("time since the first frame (s)")
        origin = recording.info.origin
        simulated = "" if origin == "hardware" else ", simulated"
        figure.suptitle(f"{title} ({origin}{simulated})", fontsize=10)
    return figure


def _draw_pixels(panel: Any, recording: Recording, start_s: float) -> None:
    ohm = solve_resistance_ohm(recording)
    _, pixel_rows, pixel_cols = ohm.shape
    for index in range(pixel_rows * pixel_cols):
        row, col = divmod(index, pixel_cols)
        # The infinite resistance of an open pixel becomes a gap in the line.
        values = np.where(np.isfinite(ohm[:, row, col]), ohm[:, row, col], np.nan)
        panel.plot(
            recording.time_s - start_s,
            values / 1000,
            color=_COLOURS[index % len(_COLOURS)],
            linestyle=_LINES[index // len(_COLOURS) % len(_LINES)],
            linewidth=0.9,
            label=pixel_name(row, col),
        )
    panel.set_ylabel("resistance, unfiltered (kohm)")
    if pixel_rows * pixel_cols <= _MOST_PIXELS:
        # Above the axes, because inside the legend would cover contacts and releases.
        panel.legend(
            ncols=8,
            fontsize=7,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.2,
            columnspacing=1.0,
            handlelength=1.5,
        )


def _draw_gripper(panel: Any, recording: Recording, start_s: float) -> None:
    track = recording.gripper
    driven_by_pressure = bool(np.isfinite(track.pressure_kpa).any())
    values = track.pressure_kpa if driven_by_pressure else track.width_mm
    panel.plot(track.time_s - start_s, values, color=INK)
    panel.set_ylabel("pressure (kPa)" if driven_by_pressure else "width (mm)")
    if np.isfinite(track.current_ma).any():
        current = panel.twinx()
        current.plot(track.time_s - start_s, track.current_ma, color=GREY, linewidth=0.8)
        current.set_ylabel("current (mA)", color=GREY)
        current.grid(visible=False)


def _draw_cells(panel: Any, recording: Recording, start_s: float) -> None:
    readings = recording.load_cells
    time_s = [reading.time_s - start_s for reading in readings]
    calibrated = all(reading.force_n for reading in readings)
    for cell in range(len(readings[0].raw)):
        values = [(r.force_n if calibrated else r.raw)[cell] for r in readings]
        panel.plot(time_s, values, color=_COLOURS[cell], label=f"cell {cell}")
    panel.set_ylabel("force (N)" if calibrated else "load cell (raw)")
    panel.legend(fontsize=7)


def _draw_events(panels: list[Any], recording: Recording, start_s: float) -> None:
    for event in recording.events[:_MOST_EVENTS]:
        for panel in panels:
            panel.axvline(event.time_s - start_s, color=ORANGE, linewidth=0.8, alpha=0.7)
        panels[0].annotate(
            event.name,
            (event.time_s - start_s, 1.0),
            xycoords=("data", "axes fraction"),
            rotation=90,
            fontsize=7,
            color=ORANGE,
            va="top",
            ha="right",
        )
