"""The texts of the pages, and their translation."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from packages.station.tests.dashboard.test_live import page_of

from palpate.errors import InputError
from palpate_station.dashboard.session import Session
from palpate_station.dashboard.words import Words


def test_words_of_a_translation_replace_the_english_ones_on_the_page(tmp_path: Path) -> None:
    file = tmp_path / "de.json"
    file.write_text(json.dumps({"next.no_rig": "Wählen Sie ein Gerät"}))
    session = Session(send=lambda message: None, words=Words.read(file))
    assert page_of(session)["operator"]["next"] == "Wählen Sie ein Gerät"
    assert Words.read(file).fill("<b>{{next.wait}}</b>") == "<b>Wait</b>"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('{"nowhere": "x"}', "no text has the key 'nowhere'"),
        ('{"opens_in": "bald"}', "must have the placeholders s, not none"),
        ("[]", "not an object of texts"),
        ("{", "Expecting property name"),
    ],
)
def test_words_refuse_a_translation_that_does_not_fit(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "de.json"
    file.write_text(text)
    with pytest.raises(InputError, match=why):
        Words.read(file)


def test_alarms_list_every_new_problem_of_the_devices() -> None:
    devices = Session(send=lambda message: None).devices
    for text in ("the sensor is silent", "the sensor is silent", "", "the disk is full"):
        devices.trouble = text
    assert [text for _, text in devices.alarms] == ["the sensor is silent", "the disk is full"]
