"""The sorting study on synthetic crates."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from palpate.cli import run
from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import Grasp
from palpate.produce.sorting.hand import TimedGrasp
from palpate_studies import crates as crates_module
from palpate_studies import sorting
from palpate_studies.crates import CrateItemGrasps, measure_crates, read_crates, write_crates

pytestmark = pytest.mark.slow

#: Size, mm, and stiffness, N/mm, of the trained kinds and of an untrained kind.
TAUGHT = {"egg": (44.0, 12.0), "kiwi": (50.0, 1.5), "lime": (45.0, 3.5), "apple": (63.0, 6.0)}
STRANGER = {"grape": (18.0, 1.0)}


def grasp(
    item_id: str, size_mm: float, stiffness: float, *, sensor: int, outcome: Outcome = Outcome.HELD
) -> TimedGrasp:
    def measured(value: float, factor: float, unit: str) -> Measurement:
        return Measurement(value=value, low=value / factor, high=value * factor, unit=unit)

    one = Grasp(
        item_id=item_id,
        taken_at=datetime(2026, 1, 1, tzinfo=UTC),
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=outcome,
        calibration_id=f"twin-{sensor}",
        measurements={
            "size_mm": measured(size_mm, 1.01, "mm"),
            "stiffness_n_per_mm": measured(stiffness, 1.6, "n_per_mm"),
            "force_n": measured(2.5, 1.3, "n"),
            "settled_percent": Measurement(value=-20.0, low=-22.0, high=-18.0, unit="percent"),
        },
    )
    return TimedGrasp(grasp=one, lasted_s=12.0)


def synthetic_crates(
    *, levels: Sequence[str] = ("lab", "field"), sensors: int = 2
) -> list[CrateItemGrasps]:
    rng = np.random.default_rng(5)
    found = []
    for level in levels:
        for sensor in range(sensors):
            for teaches, count in ((True, 9), (False, 4)):
                kinds = TAUGHT if teaches else {**TAUGHT, **STRANGER}
                for kind, (size, stiffness) in kinds.items():
                    for number in range(count):
                        name = f"{'taught' if teaches else 'item'}-{kind}-{number}"
                        true_mm = size * float(np.exp(0.04 * rng.standard_normal()))
                        true_k = stiffness * float(np.exp(0.15 * rng.standard_normal()))
                        found.append(
                            CrateItemGrasps(
                                level=level,
                                sensor=sensor,
                                item_id=name,
                                kind=kind,
                                teaches=teaches,
                                known=kind in TAUGHT,
                                size_mm=true_mm,
                                damaged=False,
                                grasps=tuple(
                                    grasp(
                                        name,
                                        true_mm,
                                        true_k * float(np.exp(0.1 * rng.standard_normal())),
                                        sensor=sensor,
                                    )
                                    for _ in range(2 if teaches else 3)
                                ),
                            )
                        )
    return found


def select_row(summary: list[dict[str, Any]], level: str, method: str) -> dict[str, Any]:
    return next(row for row in summary if (row["level"], row["method"]) == (level, method))


@pytest.fixture(scope="module")
def crates() -> list[CrateItemGrasps]:
    return synthetic_crates()


def test_identifier_names_most_items_and_rejects_unknown_kind(
    crates: list[CrateItemGrasps],
) -> None:
    found = sorting.judge(crates).payload["identify"]
    ours = select_row(found, "lab", "ours, 3 grasps")
    assert ours["right"] > 0.9
    assert ours["falsely_unknown"] <= 0.2
    assert ours["strangers_found"] == 1.0
    assert ours["items"] == 32
    abroad = select_row(found, "field", "ours, taught on other sensors")
    assert abroad["right"] > 0.7


def test_name_items_with_one_sensor_skips_training_on_other_sensors() -> None:
    given = sorting.name_items(synthetic_crates(levels=("lab",), sensors=1))
    assert "ours, taught on other sensors" not in {one.method for one in given}
    assert {one.level for one in given} == {"lab"}


def test_item_without_measurements_is_unknown_to_every_method(
    crates: list[CrateItemGrasps],
) -> None:
    lost = [
        item
        if item.teaches
        else replace(
            item,
            grasps=tuple(
                TimedGrasp(
                    grasp=replace(one.grasp, outcome=Outcome.SLIPPED, measurements={}),
                    lasted_s=9.0,
                )
                for one in item.grasps
            ),
        )
        for item in crates
    ]
    answers = {one.answer for one in sorting.name_items(lost)}
    assert answers == {"unknown"}
    placed = sorting.sort_crates(lost)
    assert {one.bin for each in placed.values() for one in each} == {sorting.BOOK.default_bin}


def test_more_grasps_leave_fewer_items_unsorted_at_high_purity(
    crates: list[CrateItemGrasps],
) -> None:
    found = sorting.judge(crates).payload["summary"]
    one, three = (select_row(found, "lab", m) for m in ("ours, one grasp", "ours, up to 3 grasps"))
    assert three["purity"] > 0.9
    assert three["left_over"] < one["left_over"]
    assert three["items_per_hour"] < one["items_per_hour"] == pytest.approx(3600 / 16)


def test_crates_file_roundtrip_preserves_items(
    crates: list[CrateItemGrasps], tmp_path: Path
) -> None:
    write_crates(crates, tmp_path / "crates.json")
    reread = read_crates(tmp_path / "crates.json")
    assert [replace(one, grasps=()) for one in reread] == [
        replace(one, grasps=()) for one in crates
    ]
    write_crates(reread, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == (tmp_path / "crates.json").read_text()
    assert json.loads((tmp_path / "crates.json").read_text())["simulated"] is True


def test_read_crates_of_other_file_raises(tmp_path: Path) -> None:
    path = tmp_path / "crates.json"
    with pytest.raises(InputError, match="No such file"):
        read_crates(path)
    path.write_text('{"rows": []}')
    with pytest.raises(InputError, match=r"not crates.json of `palpate study sorting --out`"):
        read_crates(path)


def test_sorting_command_with_crates_file_writes_crates(
    crates: list[CrateItemGrasps],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_crates(crates, tmp_path / "in.json")
    app = typer.Typer()
    app.command()(sorting.command)
    arguments = ["--crates", str(tmp_path / "in.json"), "--out", str(tmp_path / "out"), "--json"]
    assert run(app, arguments, name="study") == 0
    assert json.loads(capsys.readouterr().out)["simulated"] is True
    assert (tmp_path / "out" / "crates.json").is_file()


def test_measure_crates_returns_grasps_of_each_item(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, kinds in (("TRAINED_KINDS", ["egg"]), ("UNTRAINED_KINDS", ["walnut"])):
        monkeypatch.setattr(crates_module, name, dict.fromkeys(kinds))
    found = measure_crates(level="lab", sensor=7, training_items=1, sorted_items=1)
    assert [(i.kind, i.teaches, i.known, len(i.grasps)) for i in found] == [
        ("egg", True, True, 2),
        ("egg", False, True, 3),
        ("walnut", False, False, 3),
    ]
    first = found[0].grasps[0].grasp
    assert first.outcome is Outcome.HELD
    assert first.calibration_id == "twin-7"
    size = [one.grasp.measurements["size_mm"].value for one in found[1].grasps]
    assert np.mean(size) == pytest.approx(found[1].size_mm, rel=0.05)
