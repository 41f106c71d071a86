"""The store preserves any record."""

from __future__ import annotations

import string
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement, Status
from palpate_station.records import MEASURED, About, Grasp, Item, Source, Verdict
from palpate_station.store import Store

numbers = st.floats(allow_nan=False, allow_infinity=False)
maybe = st.none() | numbers
texts = st.text(
    st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=20
) | st.sampled_from(["'; DROP TABLE items; --", "a b", "{time}", "%s", ":name"])
times = st.datetimes(
    min_value=datetime(1990, 1, 1),
    max_value=datetime(2100, 1, 1),
    timezones=st.sampled_from([UTC, timezone(timedelta(hours=-9, minutes=-30))]),
)
json_values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(string.printable, max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=5,
)


@st.composite
def measurements(draw: st.DrawFn) -> dict[str, Measurement]:
    names = draw(st.sets(st.sampled_from(list(MEASURED))))
    return {
        name: Measurement(
            value=draw(numbers),
            low=draw(numbers),
            high=draw(numbers),
            unit=MEASURED[name],
            level=draw(st.floats(0, 1)),
            status=draw(st.sampled_from(list(Status))),
        )
        for name in names
    }


@st.composite
def pixels(draw: st.DrawFn) -> tuple[tuple[float | None, ...], ...] | None:
    if draw(st.booleans()):
        return None
    columns = draw(st.integers(1, 3))
    row = st.tuples(*[maybe] * columns)
    return tuple(draw(st.lists(row, min_size=1, max_size=4)))


items = st.builds(
    Item,
    item_id=texts,
    kind=st.none() | texts,
    batch=st.none() | texts,
    label=st.none() | texts,
    first_seen=times,
)
grasps = st.builds(
    Grasp,
    item_id=texts,
    taken_at=times,
    rig=texts,
    drive=st.sampled_from(["width", "pressure"]),
    origin=st.sampled_from(["hardware", "firmware-simulated", "twin"]),
    outcome=st.sampled_from(list(Outcome)),
    measurements=measurements(),
    pixel_settled_percent=pixels(),
    decision_time_s=maybe,
    peak_force_n=maybe,
    angle_deg=maybe,
    height_mm=maybe,
    temperature_c=maybe,
    humidity_percent=maybe,
    recording=st.none() | texts,
    grasp_id=st.uuids().map(str),
)
verdicts = st.builds(
    Verdict,
    item_id=texts,
    about=st.sampled_from(list(About)),
    text=texts,
    given_at=times,
    probability=st.none() | st.floats(0, 1),
    explanation=st.text(string.printable, max_size=30),
    details=st.dictionaries(texts, json_values, max_size=3),
    source=st.sampled_from(list(Source)),
    verdict_id=st.uuids().map(str),
)


@pytest.mark.slow
@settings(max_examples=30)
@given(item=items, grasp=grasps, verdict=verdicts)
def test_store_roundtrip_preserves_records(item: Item, grasp: Grasp, verdict: Verdict) -> None:
    with Store.open("sqlite://") as store:
        for name in {item.item_id, verdict.item_id}:
            store.add_item(Item(item_id=name, first_seen=item.first_seen))
        store.add_item(item)
        store.add_grasp(grasp)
        store.add_verdict(verdict)
        found = store.item(item.item_id)
        assert (found.kind, found.batch, found.label) == (item.kind, item.batch, item.label)
        assert store.grasps_of(grasp.item_id) == (grasp,)
        assert store.verdicts_of(verdict.item_id) == (verdict,)
