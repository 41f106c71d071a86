"""The figure of a recording: pixels, gripper, load cells and events."""

import dataclasses

import pytest
from tests.pdf_fonts import check_fonts

from palpate.plots.recording import recording_figure
from palpate.plots.style import save_figure
from palpate.recording import Event, load_recording
from palpate.recording.exporting import solve_resistance_ohm


@pytest.fixture
def recording(recorded):
    return load_recording(recorded)


def test_recording_figure_draws_pixels_width_force_and_events(recording):
    figure = recording_figure(recording, title="run")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert {f"R{row} C{col}" for row in range(4) for col in range(2)} <= set(lines)
    first = lines["R0 C0"].get_ydata()
    assert first == pytest.approx(solve_resistance_ohm(recording)[:, 0, 0] / 1000)
    assert figure.get_suptitle() == "run (twin, simulated)"


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
