"""Convert the grasps of an item to EPCIS 2.0 events for traceability."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from palpate_station.line.gs1 import item_uri, station_uri
from palpate_station.records import About, Grasp, Verdict
from palpate_station.store.item_history import ItemHistory

#: Measurement -> type (a GS1 Web Vocabulary term if one exists) and unit (UN/ECE Recommendation
#: 20).
_REPORT_TYPES = {
    "size_mm": ("Length", "MMT"),
    "force_n": ("Force", "NEW"),
    "stiffness_n_per_mm": ("palpate:stiffness", "F47"),
    "firmness": ("palpate:firmness", "C62"),
}
#: Field of a report -> part of the measurement; a report omits unknown parts.
_NUMBERS = {
    "value": "value",
    "palpate:low": "low",
    "palpate:high": "high",
    "palpate:level": "level",
}
_CONTEXT = (
    "https://ref.gs1.org/standards/epcis/2.0.0/epcis-context.jsonld",
    {"palpate": "urn:palpate:epcis:"},
)


def epcis_document(history: ItemHistory, *, created_at: datetime) -> dict[str, Any]:
    """Return an EPCIS document with one event for each grasp of an item.

    Each event has a sensor report for each known size, force, stiffness, firmness and bin. The
    fields ``palpate:low`` and ``palpate:high`` are the limits of the measurement's interval.

    `created_at`: creation date of the document, timezone-aware.
    """
    return {
        "@context": list(_CONTEXT),
        "type": "EPCISDocument",
        "schemaVersion": "2.0",
        "creationDate": created_at.astimezone(UTC).isoformat(),
        "epcisBody": {
            "eventList": [_event(grasp, verdicts=history.verdicts) for grasp in history.grasps]
        },
    }


def _event(grasp: Grasp, *, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    time = grasp.taken_at.isoformat()
    event: dict[str, Any] = {
        "type": "ObjectEvent",
        "eventID": f"urn:uuid:{grasp.grasp_id}",
        "eventTime": time,
        "eventTimeZoneOffset": "+00:00",
        "epcList": [item_uri(grasp.item_id)],
        "action": "OBSERVE",
        "bizStep": "inspecting",
        "palpate:outcome": str(grasp.outcome),
        "palpate:simulated": grasp.is_simulated,
    }
    reports: list[dict[str, Any]] = []
    for name, (kind, unit) in _REPORT_TYPES.items():
        if (measurement := grasp.measurements.get(name)) is None:
            continue
        found = measurement.to_dict()
        reports.append({"type": kind, "uom": unit, "palpate:status": found["status"]})
        for key, part in _NUMBERS.items():
            if found[part] is not None:
                reports[-1][key] = found[part]
    bins = [one for one in verdicts if one.about is About.BIN and one.grasp_id == grasp.grasp_id]
    reports += [{"type": "palpate:bin", "stringValue": one.text} for one in bins[-1:]]
    if grasp.station is not None:
        event["readPoint"] = {"id": station_uri(grasp.station)}
    if reports:
        device = f"urn:palpate:rig:{quote(grasp.rig, safe='')}"
        metadata = {"time": time, "deviceID": device}
        event["sensorElementList"] = [{"sensorMetadata": metadata, "sensorReport": reports}]
    return event
