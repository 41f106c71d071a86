"""The study of the mixed crate, on crates made up here: what it counts."""

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

#: Size, mm, and stiffness, N/mm, of kinds of the crate, and of a stranger.
TAUGHT = {"egg": (44.0, 12.0), "kiwi": (50.0, 1.5), "lime": (45.0, 3.5), "apple": (63.0, 6.0)}
STRANGER = {"grape": (18.0, 1.0)}


def grasp(
    item_id: str, size_mm: float, stiffness: float, *, sensor: int, outcome: Outcome = Outcome.HELD
) -> TimedGrasp:
    def felt(value: float, share: float, unit: str) -> Measurement:
        return Measurement(value=value, low=value / share, high=value * share, unit=unit)

    one = Grasp(
        item_id=item_id,
        taken_at=datetime(2026, 1, 1, tzinfo=UTC),
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=outcome,
        calibration_id=f"twin-{sensor}",
        measurements={
            "size_mm": felt(size_mm, 1.01, "mm"),
            "stiffness_n_per_mm": felt(stiffness, 1.6, "n_per_mm"),
            "force_n": felt(2.5, 1.3, "n"),
            "settled_percent": Measurement(value=-20.0, low=-22.0, high=-18.0, unit="percent"),
        },
    )
    return TimedGrasp(grasp=one, lasted_s=12.0)


def made_up(*, levels: Sequence[str] = ("lab", "field"), sensors: int = 2) -> list[CrateItemGrasps]:
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


def of(summary: list[dict[str, Any]], level: str, method: str) -> dict[str, Any]:
    return next(row for row in summary if (row["level"], row["method"]) == (level, method))


@pytest.fixture(scope="module")
def crates() -> list[CrateItemGrasps]:
    return made_up()


def test_ours_names_most_items_and_finds_the_stranger(crates: list[CrateItemGrasps]) -> None:
    found = sorting.judge(crates).payload["identify"]
    ours = of(found, "lab", "ours, 3 grasps")
    assert ours["right"] > 0.9
    assert ours["falsely_unknown"] <= 0.2
    assert ours["strangers_found"] == 1.0
    assert ours["items"] == 32
    abroad = of(found, "field", "ours, taught on other sensors")
    assert abroad["right"] > 0.7


def test_one_sensor_has_no_other_to_be_taught_on() -> None:
    given = sorting.name_items(made_up(levels=("lab",), sensors=1))
    assert "ours, taught on other sensors" not in {one.method for one in given}
    assert {one.level for one in given} == {"lab"}


def test_what_was_not_measured_is_unknown_to_all(crates: list[CrateItemGrasps]) -> None:
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
    said = {one.answer for one in sorting.name_items(lost)}
    assert said == {"unknown"}
    placed = sorting.sort_crates(lost)
    assert {one.bin for each in placed.values() for one in each} == {sorting.BOOK.default_bin}


def test_rules_make_pure_bins_and_leave_less_over_after_more_grasps(
    crates: list[CrateItemGrasps],
) -> None:
    found = sorting.judge(crates).payload["summary"]
    one, three = (of(found, "lab", m) for m in ("ours, one grasp", "ours, up to 3 grasps"))
    assert three["purity"] > 0.9
    assert three["left_over"] < one["left_over"]
    assert three["items_per_hour"] < one["items_per_hour"] == pytest.approx(3600 / 16)


def test_crates_are_read_as_they_were_written(
    crates: list[CrateItemGrasps], tmp_path: Path
) -> None:
    write_crates(crates, tmp_path / "crates.json")
    again = read_crates(tmp_path / "crates.json")
    assert [replace(one, grasps=()) for one in again] == [replace(one, grasps=()) for one in crates]
    write_crates(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == (tmp_path / "crates.json").read_text()
    assert json.loads((tmp_path / "crates.json").read_text())["simulated"] is True


def test_a_file_that_holds_no_crates_says_so(tmp_path: Path) -> None:
    path = tmp_path / "crates.json"
    with pytest.raises(InputError, match="No such file"):
        read_crates(path)
    path.write_text('{"rows": []}')
    with pytest.raises(InputError, match=r"not crates.json of `palpate study sorting --out`"):
        read_crates(path)


def test_the_command_writes_what_it_read(
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


def test_a_crate_is_measured_by_grasps(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, kinds in (("CRATE_TAUGHT", ["egg"]), ("CRATE_STRANGERS", ["walnut"])):
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
