"""A gripper made of any object with `width_mm`, `move` and `stop`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from palpate.clock import ManualClock
from palpate.errors import DeviceError, InputError
from palpate.gripper.interface import GripperCommand
from palpate.gripper.plain import PlainGripper
from palpate.rig.file import open_device


class Rack:
    """A rack that is where it was sent."""

    width_mm = 60.0
    lowest_mm, highest_mm, fastest_mm_s = 4.0, 70.0, 30.0

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []

    def move(self, width_mm: float, speed_mm_s: float) -> None:
        self.calls.append((width_mm, speed_mm_s))
        self.width_mm = width_mm

    def stop(self) -> None:
        self.calls.append(("stop",))


class Broken(Rack):
    """A rack whose port was pulled."""

    def stop(self) -> None:
        raise OSError("port is gone")

    @property
    def current_ma(self) -> float:
        raise ValueError("no answer")


def test_commands_are_clamped_and_returned_as_sent() -> None:
    rack = Rack()
    hand = PlainGripper(rack)
    sent = hand.command(GripperCommand(target=1.0, rate=90.0))
    assert (sent.target, sent.rate) == (4.0, 30.0)
    hand.release()
    hand.stop()
    assert rack.calls == [(4.0, 30.0), (70.0, 30.0), ("stop",)]


def test_a_hand_without_a_flag_moves_until_its_width_is_constant() -> None:
    rack, clock = Rack(), ManualClock()
    hand = PlainGripper(rack, clock=clock)
    clock.sleep_s(1.0)
    assert not hand.state().moving
    hand.command(GripperCommand(target=50.0, rate=10.0))
    assert hand.state().moving
    clock.sleep_s(0.09)
    assert hand.state().moving
    clock.sleep_s(0.11)
    state = hand.state()
    assert (state.moving, state.width_mm) == (False, 50.0)
    assert math.isnan(state.current_ma)


def test_stated_movement_and_current_of_the_object_are_used() -> None:
    class Told(Rack):
        current_ma = 120.0

        def is_moving(self) -> bool:
            return True

    state = PlainGripper(Told()).state()
    assert (state.moving, state.current_ma) == (True, 120.0)


def test_errors_of_the_object_name_it_and_its_method() -> None:
    hand = PlainGripper(Broken())
    with pytest.raises(DeviceError, match=r"Broken\.stop: OSError: port is gone"):
        hand.stop()
    with pytest.raises(DeviceError, match=r"Broken\.current_ma: ValueError: no answer"):
        hand.state()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lowest_mm": 80.0}, "80 to 70 mm"),
        ({"fastest_mm_s": -1.0}, "0 to -1 mm/s"),
        ({"width_mm": math.nan}, "width_mm is nan"),
        ({"width_mm": 0.0, "highest_mm": 0.0}, "open the hand"),
    ],
)
def test_a_range_that_is_not_valid_is_refused(changes: dict[str, float], message: str) -> None:
    rack = type("Rack", (Rack,), changes)()
    with pytest.raises((InputError, DeviceError), match=message):
        PlainGripper(rack)


def test_a_rig_file_accepts_such_an_object_and_names_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "rack_of_mine.py").write_text(
        "class Rack:\n"
        "    width_mm = 60.0\n"
        "    def move(self, width_mm, speed_mm_s): self.width_mm = width_mm\n"
        "    def stop(self): pass\n"
        "class Half:\n"
        "    width_mm = 60.0\n"
    )
    path = tmp_path / "rig.toml"
    hand = open_device(path, "gripper", {"open": "rack_of_mine:Rack"})
    assert hand.limits.highest == 60.0
    with pytest.raises(InputError, match="Half has no move and no stop"):
        open_device(path, "gripper", {"open": "rack_of_mine:Half"})
