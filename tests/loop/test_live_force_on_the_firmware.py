"""`palpate live --force` at 250 frames/s from the real firmware over a pseudo-terminal."""

from __future__ import annotations

import re

import numpy as np
import pytest
from rich.console import Console

from palpate.calibrate.laws import force_now
from palpate.cli.live_reading import LiveReading
from palpate.cli.live_view import LiveView
from palpate.cli.sensor_source import SensorSource
from palpate.clock import ManualClock
from palpate.gripper.interface import GripperCommand
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import draw_object
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")

RATE_HZ, HELD_S = 250.0, 4.0


def test_live_force_has_an_interval_at_every_frame() -> None:
    calibration = calibrate_twin(seed=3, level="lab", apart_from="ball-44lbs")
    clock = ManualClock(50.0)
    ball = draw_object(np.random.default_rng(3), "ball-44lbs")
    world = World(ball, seed=5, sheet_seed=3, clock=clock, layout=RIGID_LAYOUT)
    stream = FirmwareStream(world, board=FirmwareBoard(seed=1))
    array = SerialArray(stream, clock=clock, layout=RIGID_LAYOUT, rate_hz=RATE_HZ, oversampling=1)
    source = SensorSource(name="pad", array=array, calibration=calibration)
    follower = force_now(calibration.force)
    rest_ohm = source.rest_ohm()
    view = LiveView(LiveReading(source, rest_ohm=rest_ohm, clock=clock, force=follower))
    gripper = TwinGripper(world)
    gripper.command(GripperCommand(target=ball.size_mm - 3.0, rate=40.0))
    frames = []
    end_s = clock.now_s() + 2.0 + HELD_S
    while clock.now_s() < end_s:
        frames.append(array.read(timeout_s=1.0))
        view.add(frames[-1])
    true_n, lost = world.force_n(clock.now_s()), array.counters.lost
    array.close()
    assert lost == 0
    assert len(frames) == pytest.approx(RATE_HZ * (2.0 + HELD_S), abs=3)
    console = Console(width=100)
    with console.capture() as shown:
        console.print(view.render(console))
    found = re.search(r"force now (\S+) N \((\S+) to (\S+), 90%\)", shown.get())
    value, low, high = map(float, found.groups())
    assert true_n > 1.0
    assert low < true_n < high
    assert value == pytest.approx(true_n, rel=0.3)
