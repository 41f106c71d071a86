"""`palpate live`: the view, the simulated squeeze and refused options."""

from __future__ import annotations

import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import numpy as np
from rich.console import Console
from tests.commands import Command
from tests.factories import make_sheet_law

from palpate.cli.live_reading import LiveReading
from palpate.cli.live_view import LiveView
from palpate.cli.sensor_source import SensorSource
from palpate.clock import ManualClock
from palpate.force.sheet_follower import SheetFollower
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.signal.circuit import resistance_ohm
from palpate.twin.devices import TwinArray
from palpate.twin.world import World

REST_COUNTS = np.full((4, 2), 300)


class Screen:
    """A view that receives 50 frames/s."""

    def __init__(
        self,
        *,
        calibrated: bool = True,
        simulated: bool = False,
        force: SheetFollower | None = None,
    ) -> None:
        array = TwinArray(World(None, seed=1))
        rest_ohm = resistance_ohm(REST_COUNTS, divider=RIGID_LAYOUT.divider) if calibrated else None
        source = SensorSource(name="bench", array=array, simulated=simulated)
        self.clock, self.sequence = ManualClock(), 0
        self.view = LiveView(LiveReading(source, rest_ohm=rest_ohm, clock=self.clock, force=force))

    def feed(self, counts: np.ndarray, *, frames: int = 20) -> None:
        for _ in range(frames):
            self.clock.sleep_s(0.02)
            frame = Frame(time_s=self.clock.now_s(), sequence=self.sequence, counts=counts)
            self.view.add(frame)
            self.sequence += 1

    def text(self) -> str:
        file = StringIO()
        Console(width=110, file=file).print(self.view.render(Console(width=110)))
        return file.getvalue()


def test_live_view_shows_contact_and_pixels() -> None:
    screen = Screen()
    counts = REST_COUNTS.copy()
    counts[0, 1], counts[3, 0], counts[3, 1] = 600, 0, 290
    screen.feed(counts)
    shown = screen.text()
    for words in ("-71 %", "+5 %", "open", "50.0 Hz"):
        assert words in shown
    assert (shown.count("contact"), shown.count("no contact")) == (2, 1)
    assert "SIMULATED" not in shown


def test_live_view_shows_unplugged_sensor_and_reconnects() -> None:
    screen = Screen()
    screen.feed(REST_COUNTS)
    screen.feed(np.zeros((4, 2), dtype=int), frames=40)
    shown = screen.text()
    assert shown.count("open") == 8
    assert shown.count("no pixel") == 3
    assert "nan" not in shown
    screen.feed(np.full((4, 2), 2))
    shown = screen.text()
    assert shown.count("+999 %") == 8
    assert "+999.0 %" in shown
    screen.feed(REST_COUNTS)
    assert "no pixel" not in screen.text()


def test_live_view_shows_stale_and_lost_frames() -> None:
    screen = Screen()
    screen.feed(REST_COUNTS)
    assert "50.0 Hz" in screen.text()
    screen.clock.sleep_s(0.35)
    assert "NO FRAMES" in screen.text()
    screen.sequence += 3
    screen.feed(REST_COUNTS)
    assert "3 lost" in screen.text()


def test_live_force_is_updated_at_every_frame() -> None:
    screen = Screen(force=SheetFollower(make_sheet_law(8)))
    screen.feed(REST_COUNTS)
    assert re.search(r"force now at most 0\.\d\d N, no contact", screen.text())
    screen.feed(REST_COUNTS * 2)
    value = float(screen.text().split("force now ")[1].split(" N")[0])
    assert value > 1.0


def test_live_ends_after_the_duration(rig_file: Callable[..., Path], palpate: Command) -> None:
    arguments = ("live", "--rig", rig_file(), "--duration", "0.2")
    assert "palpate live" in palpate(*arguments).out
    assert "palpate calibrate force" in palpate.refused(*arguments, "--force")
