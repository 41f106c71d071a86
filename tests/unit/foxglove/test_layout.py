"""The shipped Foxglove layout: valid panels, and plotted fields that exist."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from foxglove import layouts
from mcap.reader import make_reader

from palpate.cli import build_app, run
from palpate.foxglove import LAYOUT
from palpate.foxglove.channels import HEAT_MAP, live_schemas
from palpate.recording.channels import SCHEMAS
from palpate.sensor.array import RIGID_LAYOUT

DOCUMENT = json.loads(LAYOUT.read_text(encoding="utf-8"))
PANELS: dict[str, dict[str, Any]] = DOCUMENT["configById"]
CHANNELS = SCHEMAS | live_schemas(RIGID_LAYOUT)
PATH = re.compile(r"(?P<topic>/\w+)\.(?P<field>\w+)(\[(?P<index>\d+)\])?")
#: Series settings missing from the description in SDK 0.25, the newest version that LeRobot 0.6
#: supports.
UNDESCRIBED = {"lineStyle"} if version("foxglove-sdk").startswith("0.25.") else set()
#: JSON schema types that Foxglove supports: no unions, no null.
KNOWN_TYPES = ("boolean", "string", "number", "integer", "object", "array")


def panel_ids(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from (*panel_ids(node["first"]), *panel_ids(node["second"]))


def plotted_paths() -> list[str]:
    found = [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())]
    return found + [panel["path"] for panel in PANELS.values() if "path" in panel]


@pytest.mark.parametrize("panel", PANELS)
def test_layout_panel_has_only_settings_described_by_the_sdk(panel: str) -> None:
    settings = getattr(layouts, f"{panel.split('!')[0]}Config")()._to_dict()
    assert set(PANELS[panel]) - {"foxglovePanelTitle"} <= set(settings)
    if "imageMode" in PANELS[panel]:
        assert set(PANELS[panel]["imageMode"]) <= set(layouts.ImageModeConfig()._to_dict())
    for path in PANELS[panel].get("paths", ()):
        series = getattr(layouts, f"{panel.split('!')[0]}Series")()._to_dict()
        assert set(path) - UNDESCRIBED <= set(series)


def test_layout_places_every_panel_once_and_uses_fields_of_existing_channels() -> None:
    for path in plotted_paths():
        found = PATH.fullmatch(path)
        field = CHANNELS[found["topic"]]["properties"][found["field"]]
        assert (field["type"] == "array") == (found["index"] is not None), path
    assert sorted(panel_ids(DOCUMENT["layout"])) == sorted(PANELS)
    assert PANELS["Image!heat_map"]["imageMode"]["imageTopic"] == HEAT_MAP
    assert PANELS["RawMessages!link"]["topicPath"] in CHANNELS


def test_channel_schemas_use_only_types_supported_by_foxglove() -> None:
    for schema in CHANNELS.values():
        assert schema["type"] == "object"
        for field in schema["properties"].values():
            assert field["type"] in KNOWN_TYPES
            assert field["type"] != "array" or field["items"]["type"] in KNOWN_TYPES


@pytest.mark.slow
def test_recording_has_numbers_in_the_fields_plotted_by_the_layout(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    options = ["--rig", "sim-rigid", "--duration", "1"]
    assert run(build_app(), ["record", str(file), *options], name="palpate") == 0
    messages: dict[str, dict[str, Any]] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            messages[channel.topic] = json.loads(message.data)
    assert set(messages) == {"/frames", "/gripper"}
    for path in plotted_paths():
        found = PATH.fullmatch(path)
        if found["topic"] in messages:
            value = messages[found["topic"]][found["field"]]
            number = value if found["index"] is None else value[int(found["index"])]
            assert isinstance(number, int | float)
