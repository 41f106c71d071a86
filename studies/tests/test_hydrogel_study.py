"""The study of a hydrogel sensor in a robot's force loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate_studies.hydrogel import read_contacts, report, score


def loop_csv(path: Path, *, recordings: int = 2, rest: int = 30) -> Path:
    """Write recordings of two presses each, of a sensor whose conductance follows the force."""
    channels = [f"v{number:02d}" for number in range(1, 17)]
    rows = [",".join(["recording", "time_s", "press", "force_n", "lstm_n", *channels])]
    force_n = np.concatenate([np.zeros(rest), 20.0 * np.sin(np.linspace(0.0, np.pi, 80)) ** 2])
    for recording in range(recordings):
        for press in range(2):
            for number, force in enumerate(force_n):
                voltage = 3.3 / (1.0 + 0.0005 * force)
                time_s = 0.05 * (number + press * len(force_n))
                cells = [f"r{recording}", time_s, press, force, force + 1.0, *[voltage] * 16]
                rows.append(",".join(str(cell) for cell in cells))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_hydrogel_without_rest_or_a_second_recording_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no contact of 0\.5 N with a second of rest before it"):
        read_contacts(loop_csv(tmp_path / "loop.csv", rest=4))
    with pytest.raises(InputError, match="one recording; each is held out in turn"):
        report(recordings=loop_csv(tmp_path / "loop.csv", recordings=1))


def test_hydrogel_score_on_held_out_recording_beats_mean_force(tmp_path: Path) -> None:
    contacts = read_contacts(loop_csv(tmp_path / "loop.csv"))
    rows = {row["method"]: row for row in score(contacts[:2], tested=contacts[2:])}
    assert rows["ours"]["median_abs_log_error"] < 0.5 * rows["mean force"]["median_abs_log_error"]
    assert rows["ours"]["coverage"] > 0.8
    assert rows["authors' LSTM"]["rms_n"] == pytest.approx(1.0)
