"""Every result that a researcher holds becomes a data frame."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate
from palpate.errors import MissingExtraError
from palpate.recording import RecordingReader, load_recording
from palpate.recording.exporting import frame_tables

pd = pytest.importorskip("pandas")
TIME_S = np.arange(0.0, 3.0, 0.1)
DECAY = 400.0 + 60.0 * np.exp(-TIME_S / 1.3)


def test_estimates_of_a_batch_and_of_one_hold() -> None:
    batch = palpate.predict_settled(TIME_S, np.stack([DECAY, 2.0 * DECAY]), horizon_s=20.0)
    table = palpate.to_dataframe(batch)
    np.testing.assert_allclose(table["value"], np.asarray(batch.value))
    assert table["method"].unique().tolist() == [batch.method]
    one = palpate.to_dataframe(batch.hold(1))
    assert one.shape[0] == 1
    assert one.loc[0, "status"] == table.loc[1, "status"]
    assert palpate.to_dataframe([batch.hold(0), batch.hold(1)]).equals(table)


def test_traces_of_two_recordings() -> None:
    known = {"weight_g": [0, 120, 350, 800], "R_ohm": [30e3, 4e3, 1500.0, 700.0]}
    traces = palpate.fit_force(known).force({"R_ohm": [30e3, 2e3, 900.0]})
    table = palpate.to_dataframe([*traces, *traces])
    np.testing.assert_allclose(table["force_n"][:3], traces[0].force_n)
    assert len(table) == 6


def test_a_grasp_and_the_readings_of_its_hold() -> None:
    with palpate.open_rig("sim-rigid", object_name="kiwi", seed=9) as rig:
        grip = rig.grasp(target_force_n=1.5)
        readings = [rig.read() for _ in range(4)]
        live = palpate.to_dataframe(readings)
        grip.release()
    assert live["time_s"].is_monotonic_increasing
    first = readings[0].force_n
    assert first is not None
    assert live.loc[0, ["force_n", "force_n_low", "force_n_high"]].tolist() == [
        first.value, first.low, first.high,
    ]  # fmt: skip
    assert live["r3c1_resistance_ohm"].tolist() == [one.resistance_ohm[3, 1] for one in readings]
    table = palpate.to_dataframe(grip)
    assert table.loc[0, "outcome"] == "held"
    assert grip.size_mm is not None
    assert table.loc[0, "size_mm"] == grip.size_mm.value
    assert palpate.to_dataframe([grip.result, grip.result]).shape[0] == 2


def test_a_bound_has_no_value() -> None:
    force = palpate.Measurement(value=2.0, low=1.0, high=9.0, unit="n")
    bound = replace(force, status=palpate.Status.AT_LEAST)
    table = palpate.to_dataframe([force, bound])
    assert table["value"].isna().tolist() == [False, True]


def test_holds_and_recordings(recorded: Path) -> None:
    table = {"ms": 1e3 * TIME_S, "A0": DECAY.round(), "A1": (DECAY / 2).round()}
    frame = palpate.to_dataframe(palpate.read_recording(table))
    assert frame["A1"].tolist() == table["A1"].tolist()
    assert frame["time_s"].tolist() == pytest.approx(TIME_S.tolist())
    recording = load_recording(recorded)
    frame = palpate.to_dataframe(recording)
    with RecordingReader(recorded) as reader:
        [exported] = frame_tables(reader)
    assert frame.equals(pd.DataFrame(exported))


@pytest.mark.parametrize("other", ["text", 3, TIME_S])
def test_anything_else_is_refused(other: Any) -> None:
    with pytest.raises(palpate.InputError, match="no result"):
        palpate.to_dataframe(other)


def test_missing_pandas_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r"palpate\[data\]"):
        palpate.to_dataframe([])
