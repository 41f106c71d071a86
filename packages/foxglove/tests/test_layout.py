"""The shipped Foxglove layout: valid panels, and plotted fields that exist."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

import pytest
from foxglove import layouts

from palpate.recording.channels import SCHEMAS
from palpate.sensor.array import RIGID_LAYOUT
from palpate_foxglove import LAYOUT
from palpate_foxglove.channels import live_schemas

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


@pytest.mark.parametrize("panel", PANELS)
def test_layout_panel_has_only_settings_described_by_the_sdk(panel: str) -> None:
    settings = getattr(layouts, f"{panel.split('!')[0]}Config")()._to_dict()
    assert set(PANELS[panel]) - {"foxglovePanelTitle"} <= set(settings)
    if "imageMode" in PANELS[panel]:
        assert set(PANELS[panel]["imageMode"]) <= set(layouts.ImageModeConfig()._to_dict())
    for path in PANELS[panel].get("paths", ()):
        series = getattr(layouts, f"{panel.split('!')[0]}Series")()._to_dict()
        assert set(path) - UNDESCRIBED <= set(series)


def test_channel_schemas_use_only_types_supported_by_foxglove() -> None:
    for schema in CHANNELS.values():
        assert schema["type"] == "object"
        for field in schema["properties"].values():
            assert field["type"] in KNOWN_TYPES
            assert field["type"] != "array" or field["items"]["type"] in KNOWN_TYPES
