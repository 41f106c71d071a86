"""Contacts are counted once in the use of a sheet."""

from __future__ import annotations

import numpy as np

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.placement import PixelGrid, Placements
from palpate.twin.ranges import ranges_of
from palpate.twin.velostat import Environment, draw_sheet


def gain(environment: Environment, *, contacts: int) -> float:
    """Return the mean gain of one contact with a fixed seed."""
    sheet = draw_sheet(np.random.default_rng(5), layout=RIGID_LAYOUT, level="field")
    placements = Placements(
        sheet=sheet, grid=PixelGrid.from_layout(RIGID_LAYOUT), ranges=ranges_of("field"), seed=5
    )
    return float(placements.of(1, contacts, environment=environment).gain.mean())


def test_placements_do_not_add_contacts_already_included_in_cycles() -> None:
    before = gain(Environment(cycles=200), contacts=100)
    assert gain(Environment(cycles=300, cycles_are_all=True), contacts=100) == before
    assert gain(Environment(cycles=300), contacts=100) != before
