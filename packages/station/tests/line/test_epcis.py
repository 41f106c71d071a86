"""EPCIS 2.0 documents of an item, verified with an independent EPCIS library."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from packages.station.tests.epcis import read_epcis
from packages.station.tests.factories import make_grasp

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement, Status
from palpate_station.line.epcis import epcis_document
from palpate_station.records import About, Item, Verdict
from palpate_station.store.item_history import ItemHistory

pytestmark = pytest.mark.system

AT = datetime(2026, 5, 1, 8, tzinfo=UTC)
ITEM = "(01)04012345000016(21)A17"
SIZE = Measurement(value=61.0, low=60.2, high=61.8, unit="mm")
FORCE = Measurement(value=2.9, low=2.5, high=15.0, unit="n", status=Status.AT_LEAST)


def document(**measurements: Measurement) -> dict[str, Any]:
    grasp = make_grasp(ITEM, taken_at=AT, rig="my rig.toml", measurements=measurements)
    empty = make_grasp(
        ITEM,
        taken_at=AT + timedelta(minutes=1),
        rig="my rig.toml",
        origin="hardware",
        outcome=Outcome.NOTHING_THERE,
    )
    verdict = Verdict(
        item_id=ITEM, about=About.BIN, text="ripe", given_at=AT, grasp_id=grasp.grasp_id
    )
    history = ItemHistory(item=Item(item_id=ITEM), grasps=(grasp, empty), verdicts=(verdict,))
    return epcis_document(history, created_at=AT)


@pytest.mark.slow
def test_epcis_document_is_read_unchanged_by_an_independent_library() -> None:
    written = document(size_mm=SIZE, force_n=FORCE)
    assert read_epcis(written) == written["epcisBody"]["eventList"]


@pytest.mark.slow
def test_epcis_document_with_an_invalid_action_is_refused_by_an_independent_library() -> None:
    written = document(size_mm=SIZE)
    written["epcisBody"]["eventList"][0]["action"] = "SQUEEZE"
    with pytest.raises(AssertionError, match="action"):
        read_epcis(written)


def test_epcis_document_event_contains_the_measurements_and_the_bin() -> None:
    first, second = document(size_mm=SIZE, force_n=FORCE)["epcisBody"]["eventList"]
    assert first["epcList"] == ["https://id.gs1.org/01/04012345000016/21/A17"]
    assert first["eventTime"] == "2026-05-01T08:00:00+00:00"
    assert (first["palpate:simulated"], second["palpate:simulated"]) == (True, False)
    size, force, chosen = first["sensorElementList"][0]["sensorReport"]
    assert (size["type"], size["uom"], size["value"]) == ("Length", "MMT", 61.0)
    assert (size["palpate:low"], size["palpate:high"], size["palpate:level"]) == (60.2, 61.8, 0.9)
    assert "value" not in force
    assert (force["palpate:low"], force["palpate:status"]) == (2.5, "at_least")
    assert chosen == {"type": "palpate:bin", "stringValue": "ripe"}
    assert "sensorElementList" not in second
