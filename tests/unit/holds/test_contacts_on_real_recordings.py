"""Holds found in real recordings, compared with a load cell that is not an input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.holds.contacts import find_contacts
from palpate.holds.strict import read_table

#: Definition of a press by its force, as in `palpate study presses`.
PRESS_N, PRESS_FRACTION, PRESS_S = 0.5, 0.3, 0.8


def read_recordings(path: Path, *columns: str) -> dict[str, dict[str, np.ndarray]]:
    kinds: dict[str, Any] = {"recording_id": "text", "time_s": "number"}
    table = read_table(path, columns=kinds | dict.fromkeys(columns, "number or empty"))
    labels = table["recording_id"]
    return {
        label: {name: table[name][labels == label] for name in ("time_s", *columns)}
        for label in dict.fromkeys(labels.tolist())
    }


def find_presses(time_s: np.ndarray, force_n: np.ndarray) -> list[tuple[float, float, float]]:
    """Return each press's time at 90 % of its plateau, start and end."""
    on = force_n > max(PRESS_N, PRESS_FRACTION * np.quantile(force_n, 0.9))
    edges = np.diff(np.concatenate(([0], on.astype(int), [0])))
    spans = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    found = []
    for begin, end in spans:
        inside = slice(begin, end)
        if time_s[end - 1] - time_s[begin] >= PRESS_S:
            plateau = 0.9 * np.quantile(force_n[inside], 0.8)
            loaded = time_s[inside][np.argmax(force_n[inside] >= plateau)]
            found.append((float(loaded), float(time_s[begin]), float(time_s[end - 1])))
    return found


@pytest.fixture(scope="module")
def cut_presses(real_data: Path) -> tuple[int, int, np.ndarray]:
    """Return counts of presses and unmatched holds, and start and end errors of the others."""
    total, unmatched, errors = 0, 0, []
    source = read_recordings(real_data / "velostat_presses.csv.gz", "resistance_ohm", "force_n")
    for one in source.values():
        known = find_presses(one["time_s"], one["force_n"])
        total += len(known)
        for hold in find_contacts(one["time_s"], one["resistance_ohm"], unit="ohm").holds:
            near = [press for press in known if press[1] - 1 < hold.onset_s < press[2]]
            unmatched += not near
            errors += [(hold.start_s - near[0][0], hold.end_s - near[0][2])] if near else []
    return total, unmatched, np.array(errors)


@pytest.mark.slow
def test_find_contacts_real_presses_without_false_holds(
    cut_presses: tuple[int, int, np.ndarray],
) -> None:
    total, unmatched, errors = cut_presses
    assert total > 400
    assert len(errors) >= 0.95 * total
    assert unmatched == 0


@pytest.mark.slow
def test_find_contacts_real_holds_match_force_plateau(
    cut_presses: tuple[int, int, np.ndarray],
) -> None:
    _, _, errors = cut_presses
    begin_s, end_s = errors.T
    assert abs(np.median(begin_s)) < 0.05
    assert np.quantile(np.abs(begin_s), 0.9) < 0.4
    assert np.quantile(np.abs(end_s), 0.95) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", ["velostat_strokes.csv.gz", "silicone_histories.csv.gz"])
def test_find_contacts_taps_and_slow_motion_have_no_holds(real_data: Path, name: str) -> None:
    for one in read_recordings(real_data / name, "resistance_ohm").values():
        known = np.isfinite(one["resistance_ohm"])
        found = find_contacts(one["time_s"][known], one["resistance_ohm"][known], unit="ohm")
        assert found.holds == []
        words = ("no contact", "no lasting contact", "but no hold")
        assert any(each in found.reason() for each in words)
