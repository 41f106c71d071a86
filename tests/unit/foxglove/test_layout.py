"""The layout that ships: its panels are Foxglove's, and what they plot is there."""

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

READ = json.loads(LAYOUT.read_text(encoding="utf-8"))
PANELS: dict[str, dict[str, Any]] = READ["configById"]
CHANNELS = SCHEMAS | live_schemas(RIGID_LAYOUT)
PATH = re.compile(r"(?P<topic>/\w+)\.(?P<field>\w+)(\[(?P<index>\d+)\])?")
#: Settings of a series that SDK 0.25, the newest that LeRobot 0.6 takes, does not describe.
UNDESCRIBED = {"lineStyle"} if version("foxglove-sdk").startswith("0.25.") else set()
#: What Foxglove makes of a JSON schema: no unions, no null.
KNOWN_TYPES = ("boolean", "string", "number", "integer", "object", "array")


def placed(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from (*placed(node["first"]), *placed(node["second"]))


def plotted() -> list[str]:
    found = [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())]
    return found + [panel["path"] for panel in PANELS.values() if "path" in panel]


def test_every_panel_is_placed_once() -> None:
    assert sorted(placed(READ["layout"])) == sorted(PANELS)


@pytest.mark.parametrize("panel", PANELS)
def test_a_panel_has_only_settings_that_foxglove_knows(panel: str) -> None:
    """By the SDK's own description of the panels."""
    settings = getattr(layouts, f"{panel.split('!')[0]}Config")()._to_dict()
    assert set(PANELS[panel]) - {"foxglovePanelTitle"} <= set(settings)
    if "imageMode" in PANELS[panel]:
        assert set(PANELS[panel]["imageMode"]) <= set(layouts.ImageModeConfig()._to_dict())
    for path in PANELS[panel].get("paths", ()):
        series = getattr(layouts, f"{panel.split('!')[0]}Series")()._to_dict()
        assert set(path) - UNDESCRIBED <= set(series)


@pytest.mark.parametrize("path", plotted())
def test_what_is_plotted_is_a_field_of_a_channel(path: str) -> None:
    found = PATH.fullmatch(path)
    field = CHANNELS[found["topic"]]["properties"][found["field"]]
    assert (field["type"] == "array") == (found["index"] is not None)


def test_topics_of_whole_messages_are_channels() -> None:
    assert PANELS["Image!heat_map"]["imageMode"]["imageTopic"] == HEAT_MAP
    assert PANELS["RawMessages!link"]["topicPath"] in CHANNELS


@pytest.mark.parametrize("topic", CHANNELS)
def test_a_schema_keeps_to_what_foxglove_reads(topic: str) -> None:
    assert CHANNELS[topic]["type"] == "object"
    for field in CHANNELS[topic]["properties"].values():
        assert field["type"] in KNOWN_TYPES
        if field["type"] == "array":
            assert field["items"]["type"] in KNOWN_TYPES


@pytest.mark.slow
def test_a_recording_has_numbers_where_the_layout_plots_them(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    options = ["--rig", "sim-rigid", "--duration", "1"]
    assert run(build_app(), ["record", str(file), *options], name="palpate") == 0
    messages: dict[str, dict[str, Any]] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            messages[channel.topic] = json.loads(message.data)
    assert set(messages) == {"/frames", "/gripper"}
    for path in plotted():
        found = PATH.fullmatch(path)
        if found["topic"] in messages:
            value = messages[found["topic"]][found["field"]]
            number = value if found["index"] is None else value[int(found["index"])]
            assert isinstance(number, int | float)
