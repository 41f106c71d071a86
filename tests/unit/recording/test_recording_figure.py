"""The figure of a recording: pixels, gripper, load cells and events."""

import dataclasses

import numpy as np
import pytest
from tests.pdf_fonts import check_fonts

from palpate.plots.recording import recording_figure
from palpate.plots.style import save_figure
from palpate.recording import Event, load_recording
from palpate.recording.exporting import solve_resistance_ohm


@pytest.fixture
def recording(recorded):
    return load_recording(recorded)


def _labels(figure):
    return [axes.get_ylabel() for axes in figure.axes]


def test_recording_figure_has_one_line_per_pixel_in_kilohm(recording):
    pixels = recording_figure(recording, title="run").axes[0]
    lines = {line.get_label(): line for line in pixels.lines}
    assert {f"R{row} C{col}" for row in range(4) for col in range(2)} <= set(lines)
    first = lines["R0 C0"].get_ydata()
    assert first == pytest.approx(solve_resistance_ohm(recording)[:, 0, 0] / 1000)


def test_recording_figure_draws_width_force_and_events(recording):
    figure = recording_figure(recording, title="run")
    assert "width (mm)" in _labels(figure)
    assert any("load cell" in label or label == "force (N)" for label in _labels(figure))
    assert [text.get_text() for text in figure.axes[0].texts] == ["note"]


def test_recording_figure_omits_panels_without_data(recording):
    nothing = np.empty(0)
    track = dataclasses.replace(
        recording.gripper,
        time_s=nothing,
        width_mm=nothing,
        pressure_kpa=nothing,
        current_ma=nothing,
        moving=np.empty(0, dtype=bool),
    )
    bare = dataclasses.replace(recording, gripper=track, load_cells=(), events=())
    assert len(recording_figure(bare, title="run").axes) == 1


def test_recording_figure_title_marks_simulated_recordings(recording):
    def title(shown):
        return recording_figure(shown, title="run").get_suptitle()

    real = dataclasses.replace(
        recording, info=dataclasses.replace(recording.info, origin="hardware")
    )
    assert title(recording) == "run (twin, simulated)"
    assert title(real) == "run (hardware)"


@pytest.mark.slow
def test_recording_figure_includes_event_after_last_frame(recording, tmp_path):
    silent = Event(time_s=float(recording.time_s[-1]) + 30.0, name="silent")
    cut = dataclasses.replace(recording, events=(silent,))
    figure = recording_figure(cut, title="run")
    first_s = float(recording.time_s[0])
    assert figure.axes[0].get_xlim()[1] == pytest.approx(silent.time_s - first_s)
    # Warnings are errors here: a name outside the axes would leave no room for the axes.
    save_figure(figure, tmp_path / "run.pdf")
    check_fonts(tmp_path / "run.pdf")


def test_recording_figure_of_large_array_has_no_legend(recording):
    few = recording_figure(recording, title="run").axes[0].get_legend()
    assert few is not None
    layout = dataclasses.replace(recording.info.layout, rows=8, cols=8, finger_of_row=(0,) * 8)
    counts = np.full((len(recording.time_s), 8, 8), 300)
    large = dataclasses.replace(
        recording, counts=counts, info=dataclasses.replace(recording.info, layout=layout)
    )
    assert recording_figure(large, title="run").axes[0].get_legend() is None
