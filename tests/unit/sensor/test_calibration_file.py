"""The calibration file: round trip, and one-line errors for invalid files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.errors import CalibrationError
from palpate.force.of_calibration import force_now
from palpate.grasp.planning import plan_grasp
from palpate.rig import open_rig
from palpate.sensor.array import RIGID_LAYOUT

CALIBRATION = Calibration(
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


def test_calibration_save_and_load_roundtrips(tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    CALIBRATION.save(path)
    assert Calibration.load(path) == CALIBRATION
    assert '"excess": [0.5, 0.7, 1.5, 2.1]' in path.read_text()
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON compliant"):
        replace(CALIBRATION, force_law={"error": float("nan")}).save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["pad.json"]


SHAKY = [None, "x", -1, 0, 1e12, float("nan"), 10**400, [], {}, True, [[1.0]]]


def places_of(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of every table, list and middle entry."""
    yield place
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from places_of(inner, (*place, name))
    elif isinstance(value, list) and value:
        middle = len(value) // 2
        yield from places_of(value[middle], (*place, middle))


@pytest.mark.slow
def test_each_value_of_a_calibration_is_used_or_refused_in_one_line() -> None:
    """The calibration of soft fingers differs in the readings on the blocks."""
    lines, used = list[str](), 0
    for rig_name in ("sim-rigid", "sim-soft"):
        rig = open_rig(rig_name, seed=1)
        document = json.loads(rig.calibration.as_text())
        if rig_name == "sim-rigid":
            # Most of a file is readings of the servo current.
            document["current"] = {k: v[::20] for k, v in document["current"].items()}
        text = json.dumps(document)
        for place in list(places_of(document))[1:]:
            if rig_name == "sim-soft" and place[0] != "block":
                continue
            for odd in SHAKY:
                changed = holder = json.loads(text)
                for key in place[:-1]:
                    holder = holder[key]
                holder[place[-1]] = odd
                try:
                    calibration = Calibration.from_text(json.dumps(changed), where="pad.json")
                except CalibrationError as error:
                    lines.append(str(error))
                    continue
                used += 1
                # Other parts affect no answer.
                if place[0] in ("layout", "rest", "force", "block", "current"):
                    with suppress(CalibrationError):
                        plan_grasp(calibration, gripper=rig.gripper)
                if place[0] in ("layout", "force"):
                    with suppress(CalibrationError):
                        force_now(calibration)
    assert len(lines) > 3 * used > 0
    assert all(line.startswith("pad.json: ") and "\n" not in line for line in lines)


def set_value(document: Any, place: str, value: object) -> None:
    """Set the value at a place; None removes it."""
    *outer, last = [int(key) if key.isdigit() else key for key in place.split(".")]
    for key in outer:
        document = document[key]
    if value is None:
        del document[last]
    else:
        document[last] = value


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        ("version", 4, r"file version 4, this one reads up to 3\); update palpate"),
        ("block.width_mm", [3], "unequal length"),
        ("made_at", "yesterday", "made_at is 'yesterday'; it must be a date such as"),
        ("force.force_n.2", 214.0, r"force\.force_n\[2\] is 214"),
        ("force.pixel_excess.2", [0.1] * 7, r"force\.pixel_excess\[2\] has 7 pixels"),
        ("force.excess.3", 9.1, r"force\.excess\[3\] is 9\.1, but its pixels add up to"),
        ("layout.name", "soft-3x2", r"layout\.name is 'soft-3x2', which has 6 x 2 pixels"),
    ],
)
def test_invalid_value_is_refused_in_one_line_with_its_place(
    place: str, value: object, named: str
) -> None:
    document = json.loads(CALIBRATION.as_text())
    document["force"]["pixel_excess"] = [[x / 8] * 8 for x in CALIBRATION.force.excess]
    Calibration.from_text(json.dumps(document))
    set_value(document, place, value)
    with pytest.raises(CalibrationError, match=named) as caught:
        Calibration.from_text(json.dumps(document), where="pad.json")
    assert str(caught.value).startswith("pad.json: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("change", [('"frames": 30', '"frames": 30, "frames": 3'), ("0.8", "NaN")])
def test_double_key_and_nan_are_refused(change: tuple[str, str]) -> None:
    with pytest.raises(CalibrationError, match=r"'frames' occurs twice|NaN is not a number"):
        Calibration.from_text(CALIBRATION.as_text().replace(*change))


@pytest.mark.parametrize("version", [1, 2])
def test_calibration_files_of_older_versions_are_read_without_obsolete_keys(version: int) -> None:
    document = json.loads(CALIBRATION.as_text())
    if version == 1:
        del document["held_out"]
    else:
        document |= {"traces": {"run": [0.0]}, "observer": {"kind": "sheet"}}
    assert Calibration.from_text(json.dumps({**document, "version": version})) == CALIBRATION
