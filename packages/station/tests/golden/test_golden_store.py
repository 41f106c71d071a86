"""A store of each released schema opens in this version without loss.

`schema-N.sql` is SQLite's dump of a store written by the version that introduced schema N. It is
never regenerated, so that a later change of a migration shows here.
"""

from __future__ import annotations

import sqlite3
from datetime import UTC, datetime
from pathlib import Path

import pytest

from palpate.measurement import Status
from palpate_station.records import About, Source
from palpate_station.store import Store
from palpate_station.store.schema import NEWEST

FOLDER = Path(__file__).parent / "store"
SCHEMAS = range(1, NEWEST["sqlite"] + 1)
MADE = datetime(2026, 5, 1, 8, 30, 0, 123456, tzinfo=UTC)


def restored(schema: int, folder: Path) -> Path:
    path = folder / "items.sqlite"
    with sqlite3.connect(path) as connection:
        connection.executescript((FOLDER / f"schema-{schema}.sql").read_text())
    connection.close()
    return path


def layout(path: Path) -> dict[str, list[object]]:
    """Return the columns, references and indexes of every table."""
    connection = sqlite3.connect(path)
    found: dict[str, list[object]] = {}
    for kind, name in connection.execute("SELECT type, name FROM sqlite_master ORDER BY name"):
        if kind == "table":
            # A key that may not be null says so twice, or once.
            found[name] = [
                (column, text, bool(present or key), default, key)
                for _, column, text, present, default, key in connection.execute(
                    f"PRAGMA table_info({name})"
                )
            ]
            found[name] += sorted(connection.execute(f"PRAGMA foreign_key_list({name})"))
        elif not name.startswith("sqlite_"):
            found[name] = list(connection.execute(f"PRAGMA index_info({name})"))
    connection.close()
    return found


@pytest.mark.parametrize("schema", SCHEMAS)
def test_old_store_opens_with_all_records(schema: int, tmp_path: Path) -> None:
    with Store.open(restored(schema, tmp_path), create=False) as store:
        (item,) = store.items()
        assert (item.item_id, item.kind, item.batch) == ("A17", "avocado", "Monday")
        (grasp,) = store.grasps_of("A17")
        assert grasp.taken_at == MADE
        assert grasp.measurements["stiffness_n_per_mm"].high == 4.25
        assert grasp.measurements["size_mm"].status is Status.FELL_BACK
        assert grasp.measurements["size_mm"].level == 0.95
        assert grasp.pixel_settled_percent == ((-40.0, None), (-43.25, -41.0))
        assert grasp.calibration_id is not None
        assert "palpate-calibration" in store.calibration(grasp.calibration_id)
        ripe, label = store.verdicts_of("A17", about=About.RIPENESS)
        assert ripe.grasp_id == grasp.grasp_id
        assert dict(ripe.details) == {"days_to_ripe": 0.5}
        assert (label.text, label.source) == ("overripe", Source.PERSON)


def test_station_of_a_grasp_is_read_since_schema_3_and_unknown_before(tmp_path: Path) -> None:
    for schema, station in ((2, None), (3, "line 1")):
        folder = tmp_path / str(schema)
        folder.mkdir()
        with Store.open(restored(schema, folder)) as store:
            assert [grasp.station for grasp in store.grasps()] == [station]


@pytest.mark.parametrize("schema", [1, 2, 3])
def test_force_of_the_firmness_of_an_old_store_becomes_a_number(
    schema: int, tmp_path: Path
) -> None:
    path = restored(schema, tmp_path)
    with sqlite3.connect(path) as connection:
        connection.execute(
            "INSERT INTO measurements VALUES (1, 'firmness_force_n', 2.0, 2.0, 2.0, 0.9, 'ok')"
        )
    connection.close()

    with Store.open(path) as store:
        (grasp,) = store.grasps_of("A17")
    assert grasp.firmness_force_n == 2.0
    assert "firmness_force_n" not in grasp.measurements
    with sqlite3.connect(path) as connection:
        names = connection.execute("SELECT name FROM measurements").fetchall()
    connection.close()
    assert ("firmness_force_n",) not in names


def test_bound_of_an_old_store_loses_its_value_but_keeps_its_limits(tmp_path: Path) -> None:
    path = restored(4, tmp_path)
    with sqlite3.connect(path) as connection:
        connection.execute(
            "INSERT INTO measurements VALUES (1, 'force_n', 8.0, 4.0, 16.0, 0.9, 'at_least')"
        )
    connection.close()
    with Store.open(path) as store:
        (grasp,) = store.grasps_of("A17")
    assert grasp.measurements["force_n"].known_ends == (4.0, None)
    with sqlite3.connect(path) as connection:
        query = "SELECT value, low, high FROM measurements WHERE name = 'force_n'"
        assert connection.execute(query).fetchall() == [(None, 4.0, 16.0)]
    connection.close()


@pytest.mark.parametrize("schema", SCHEMAS)
def test_old_store_migrates_to_current_schema(schema: int, tmp_path: Path) -> None:
    old, new = restored(schema, tmp_path), tmp_path / "new.sqlite"
    Store.open(old).close()
    Store.open(new).close()
    assert layout(old) == layout(new)
