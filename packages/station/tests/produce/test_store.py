"""Contract of all stores: SQLite, and a real PostgreSQL server."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa
from packages.station.tests.factories import make_grasp

from palpate.errors import InputError, StoreError
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement, Status
from palpate_station.records import About, Grasp, Item, Source, Verdict
from palpate_station.store import Store, schema
from palpate_station.store.engine import make_engine, store_url

MORNING = datetime(2026, 5, 1, 8, 30, 0, 123456, tzinfo=UTC)


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.system)])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'items.sqlite'}"
    named: str = request.getfixturevalue("postgresql_url")
    return named


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    with Store.open(url) as opened:
        yield opened


def open_and_read(url: str) -> None:
    with Store.open(url) as store:
        store.items()


def stiffness(value: float) -> Measurement:
    return Measurement(
        value=value, low=value - 0.5, high=value + 0.75, unit="n_per_mm", status=Status.SATURATED
    )


def grasp(item_id: str = "A17", *, hours: float = 0.0, value: float = 3.0) -> Grasp:
    settled = Measurement(value=-41.5, low=-43.0, high=-40.0, unit="percent", level=0.95)
    return make_grasp(
        item_id,
        taken_at=MORNING + timedelta(hours=hours),
        measurements={"stiffness_n_per_mm": stiffness(value), "settled_percent": settled},
        pixel_settled_percent=((-40.0, None), (-43.25, -41.0)),
        decision_time_s=1.25,
        peak_force_n=4.5,
        angle_deg=90.0,
        height_mm=-3.0,
        temperature_c=21.5,
        humidity_percent=45.0,
        recording="runs/17.mcap",
    )


def verdict(item_id: str = "A17", *, text: str = "ripe", **others: object) -> Verdict:
    fixed: dict[str, object] = {"about": About.RIPENESS, "given_at": MORNING}
    return Verdict(item_id=item_id, text=text, **{**fixed, **others})  # type: ignore[arg-type]


def test_store_returns_a_grasp_unchanged_and_only_once(store: Store) -> None:
    calibration_id = store.add_calibration('{"format": "a calibration"}')
    taken = replace(grasp(), calibration_id=calibration_id)
    assert store.add_grasps([taken, taken]) == 1
    assert not store.add_grasp(taken)
    assert store.grasps_of("A17") == (taken,)
    assert store.calibration(calibration_id) == '{"format": "a calibration"}'


def test_store_returns_a_grasp_without_measurements(store: Store) -> None:
    other = {"rig": "hall.toml", "drive": "pressure", "origin": "hardware"}
    bare = make_grasp(taken_at=MORNING, **other, outcome=Outcome.NOTHING_THERE)
    assert store.add_grasp(bare)
    assert store.grasps_of("A17") == (bare,)


def test_store_item_has_its_first_grasp_and_all_data_given_to_it(store: Store) -> None:
    store.add_grasp(grasp())
    assert store.item("A17") == Item(item_id="A17", first_seen=MORNING)
    store.add_grasps([grasp(hours=-5), grasp(hours=5)])
    store.add_item(Item(item_id="A17", kind="avocado", batch="Monday"))
    store.add_item(Item(item_id="A17", label="the dark one"))
    given = {"kind": "avocado", "batch": "Monday", "label": "the dark one"}
    first_seen = MORNING - timedelta(hours=5)
    assert store.item("A17") == Item(item_id="A17", **given, first_seen=first_seen)


def test_store_filters_items_by_kind_and_batch(store: Store) -> None:
    for number, (kind, batch) in enumerate([("kiwi", "M"), ("kiwi", "T"), ("lime", "M")]):
        seen = MORNING + timedelta(days=number)
        store.add_item(Item(item_id=f"i{number}", kind=kind, batch=batch, first_seen=seen))

    def names(**filters: object) -> list[str]:
        return [item.item_id for item in store.items(**filters)]  # type: ignore[arg-type]

    assert names() == ["i2", "i1", "i0"]
    assert names(limit=1) == ["i2"]
    assert names(kind="kiwi") == ["i1", "i0"]
    assert names(kind="kiwi", batch="M") == ["i0"]
    assert [item.item_id for item in store.items_of_batch("M")] == ["i0", "i2"]


def test_store_returns_the_grasps_of_an_item_oldest_first(store: Store) -> None:
    late, early = grasp(hours=48, value=2.0), grasp(hours=0, value=3.0)
    store.add_grasps([late, early, grasp("B2", hours=1)])
    assert store.grasps_of("A17") == (early, late)


def test_store_returns_verdicts_unchanged(store: Store) -> None:
    taken = grasp()
    store.add_grasp(taken)
    predicted = verdict(
        probability=0.9,
        explanation="3.0 N/mm, and 5.1 on Monday",
        details={"days_to_ripe": 0.5, "stages": ["hard", "ripe"]},
        grasp_id=taken.grasp_id,
    )
    label = verdict(text="overripe", source=Source.PERSON, given_at=MORNING + timedelta(days=1))
    soft = verdict(text="bruised", about=About.BRUISE, given_at=MORNING + timedelta(days=2))
    for given in (soft, label, predicted):
        assert store.add_verdict(given)
    assert not store.add_verdict(predicted)
    assert store.verdicts_of("A17") == (predicted, label, soft)
    assert store.verdicts_of("A17", about=About.RIPENESS) == (predicted, label)
    assert store.verdicts_of("A17", source=Source.PERSON) == (label,)


def test_store_returns_labels_of_a_kind_for_all_items(store: Store) -> None:
    for name, kind in (("a", "avocado"), ("k", "kiwi")):
        store.add_item(Item(item_id=name, kind=kind))
        store.add_verdict(verdict(name, source=Source.PERSON))
        store.add_verdict(verdict(name))
    found = store.verdicts(About.RIPENESS, source=Source.PERSON, kind="avocado")
    assert [label.item_id for label in found] == ["a"]
    assert len(store.verdicts(About.RIPENESS)) == 4
    assert store.verdicts(About.BIN) == ()


def test_store_refuses_a_record_without_its_item_and_adds_nothing(store: Store) -> None:
    with pytest.raises(InputError, match="grasp or calibration that is not stored"):
        store.add_verdict(verdict("nobody"))
    with pytest.raises(InputError, match="grasp or calibration that is not stored"):
        store.add_grasp(replace(grasp(), calibration_id="0000"))
    assert store.items() == ()


def test_store_iterates_over_all_grasps_in_batches(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate_station.store.reading._BATCH", 3)
    taken = [grasp(f"i{n % 4}", hours=n) for n in range(10)]
    store.add_grasps(taken)
    store.add_item(Item(item_id="i1", kind="lime"))
    assert list(store.grasps()) == taken
    assert list(store.grasps(kind="lime")) == taken[1::4]
    since, until = MORNING + timedelta(hours=2), MORNING + timedelta(hours=4)
    assert list(store.grasps(since=since, until=until)) == taken[2:4]


def test_store_returns_histories_in_the_order_of_the_names(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate_station.store.reading._MOST_VALUES", 2)
    store.add_grasps([grasp(f"i{n % 3}", hours=-n) for n in range(9)])
    predicted = verdict("i1")
    store.add_verdict(predicted)
    names = ["i2", "nobody", "i1", "i0"]
    found = list(store.histories(names))
    assert [grasps for grasps, _ in found] == [store.grasps_of(name) for name in names]
    assert [verdicts for _, verdicts in found] == [(), (), (predicted,), ()]
    assert [item.item_id for item in store.find_items(names)] == ["i2", "i1", "i0"]


def test_store_error_lists_unknown_names(store: Store) -> None:
    with pytest.raises(InputError, match="no item 'A18'; `palpate items` lists them"):
        store.item("A18")
    with pytest.raises(InputError, match="no calibration 'x'"):
        store.calibration("x")
    assert store.grasps_of("A18") == ()


def test_store_of_a_newer_version_is_refused(url: str, store: Store) -> None:
    store.items()
    engine = make_engine(store_url(url))
    with engine.begin() as connection:
        connection.exec_driver_sql("UPDATE palpate_schema SET version = 99")
    engine.dispose()
    with pytest.raises(StoreError, match=r"written by a newer palpate \(schema 99, this one"):
        open_and_read(url)


def test_store_leaves_a_foreign_database_unchanged(url: str) -> None:
    engine = make_engine(store_url(url))
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE invoices (number INTEGER)")
    with pytest.raises(StoreError, match=r"of another program .*'invoices'"):
        open_and_read(url)
    assert sa.inspect(engine).get_table_names() == ["invoices"]
    engine.dispose()


def test_store_tables_match_the_code(url: str, store: Store) -> None:
    store.items()
    engine = make_engine(store_url(url))
    inspector = sa.inspect(engine)
    tables = dict(schema.METADATA.tables)
    if engine.dialect.name == "postgresql":
        del tables["outbox"]
    assert set(inspector.get_table_names()) == set(tables)
    for name, table in tables.items():
        found = [column["name"] for column in inspector.get_columns(name)]
        assert found == [column.name for column in table.columns]
    engine.dispose()


def test_store_ids_are_uuids() -> None:
    with pytest.raises(InputError, match="not a UUID"):
        replace(grasp(), grasp_id="17")
    assert uuid.UUID(grasp().grasp_id).version == 4
