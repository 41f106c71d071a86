"""The calibration file: round trip, and one-line errors for invalid files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.errors import CalibrationError
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues


@pytest.fixture
def calibration() -> Calibration:
    return Calibration(
        sensor_id="pad-3",
        origin="hardware",
        layout=RIGID_LAYOUT,
        rest=RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30),
        force=ForcePairs(
            run=(0, 0, 1, 1),
            since_move_s=(0.4, 20.0, 0.4, 20.0),
            excess=(0.5, 0.7, 1.5, 2.1),
            relative_percent=(-5.0, -7.0, -15.0, -20.0),
            force_n=(0.8, 0.8, 2.1, 2.0),
        ),
        block=BlockPairs(block_mm=(40.0, 40.0), width_mm=(39.5, 39.0), force_n=(1.0, 3.0)),
        force_law={"law": "power", "coefficients": [0.1, 0.8, 0.0]},
        made_at="2026-05-01T10:00:00+00:00",
    )


def test_calibration_save_and_load_roundtrips(calibration: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    calibration.save(path)
    assert Calibration.load(path) == calibration
    assert '"excess": [0.5, 0.7, 1.5, 2.1]' in path.read_text()


def test_calibration_text_from_a_recording_reads_back_equal(calibration: Calibration) -> None:
    text = calibration.as_text()
    assert Calibration.from_text(text) == calibration
    with pytest.raises(
        CalibrationError, match=r"grasp\.mcap: incomplete or invalid JSON"
    ) as caught:
        Calibration.from_text(text[:200], where="grasp.mcap")
    assert "\n" not in str(caught.value)
    with pytest.raises(CalibrationError, match="calibration: not a calibration file"):
        Calibration.from_text("[]")


def test_calibration_load_of_a_truncated_file_raises(
    calibration: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / "pad.json"
    text = calibration.as_text()
    path.write_text(text[: len(text) // 2])
    with pytest.raises(CalibrationError, match=r"pad\.json: incomplete or invalid JSON") as caught:
        Calibration.load(path)
    assert "\n" not in str(caught.value)


def test_calibration_load_of_binary_data_raises(tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    path.write_bytes(bytes(range(128, 256)))
    with pytest.raises(CalibrationError, match="incomplete or invalid JSON"):
        Calibration.load(path)


def write_changed(calibration: Calibration, path: Path, **changes: object) -> Path:
    """Write the calibration with changed keys; None removes a key."""
    document = json.loads(calibration.as_text())
    for key, value in changes.items():
        if value is None:
            del document[key]
        else:
            document[key] = value
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 4}, r"file version 4, this one reads up to 3\); update palpate"),
        ({"format": "other"}, "not a calibration file"),
        ({"rest": None}, "lacks rest"),
        ({"colour": "red"}, "has unknown keys: colour"),
        ({"block": {"block_cm": [4], "width_mm": [3], "force_n": [1]}}, "lacks block_mm.*block_cm"),
        ({"block": {"block_mm": [4], "width_mm": ["x"], "force_n": [1]}}, "finite number"),
        ({"block": {"block_mm": [4, 4], "width_mm": [3], "force_n": [1]}}, "unequal length"),
        ({"rest": {"ohm": [[1.0]], "spread_percent": [[0.1]], "frames": 5}}, "values for a layout"),
        ({"made_at": "yesterday"}, "made_at is 'yesterday'; it must be a date such as"),
    ],
)
def test_calibration_file_with_an_invalid_value_raises_an_error_that_names_it(
    calibration: Calibration, tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    path = write_changed(calibration, tmp_path / "pad.json", **changes)
    with pytest.raises(CalibrationError, match=message) as caught:
        Calibration.load(path)
    assert "pad.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_failed_calibration_save_leaves_the_old_file_unchanged(
    calibration: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / "pad.json"
    calibration.save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON compliant"):
        replace(calibration, force_law={"error": float("nan")}).save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["pad.json"]


def test_force_pairs_with_constant_reference_force_are_refused() -> None:
    with pytest.raises(CalibrationError, match="load cell connected"):
        ForcePairs(
            run=(0,) * 4,
            since_move_s=(0.4,) * 4,
            excess=(1.0, 2.0, 3.0, 4.0),
            relative_percent=(-1.0,) * 4,
            force_n=(1.0,) * 4,
        )


@pytest.mark.parametrize("ohm", [0.0, -1.0, float("nan")])
def test_calibration_with_a_nonpositive_rest_value_is_refused(
    calibration: Calibration, ohm: float
) -> None:
    rest = RestValues(
        ohm=((9e3, 8e3), (9e3, ohm), (9e3, 8e3), (9e3, 8e3)),
        spread_percent=((0.1, 0.2),) * 4,
        frames=30,
    )
    with pytest.raises(CalibrationError, match="resistance above 0 ohm"):
        replace(calibration, rest=rest)


@pytest.mark.parametrize("version", [1, 2])
def test_calibration_files_of_older_versions_are_read_without_obsolete_keys(
    calibration: Calibration, tmp_path: Path, version: int
) -> None:
    path = tmp_path / "pad.json"
    document = json.loads(calibration.as_text())
    if version == 1:
        del document["held_out"]
    else:
        document |= {"traces": {"run": [0.0]}, "observer": {"kind": "sheet"}}
    path.write_text(json.dumps({**document, "version": version}))
    assert Calibration.load(path) == calibration
