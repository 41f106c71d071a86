"""Simulated servos that are removed after the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import pytest
from tests.contract.hands import Servo

MakeServo: TypeAlias = Callable[..., Servo]


@pytest.fixture
def make_servo() -> Iterator[MakeServo]:
    """Return `Servo`, whose servos are removed at the end."""
    made = list[Servo]()

    def make(model: int, **given: Any) -> Servo:
        made.append(Servo(model, **given))
        return made[-1]

    yield make
    for servo in made:
        servo.close()


@pytest.fixture
def dynamixel(make_servo: MakeServo) -> Servo:
    """Return a DYNAMIXEL servo that is not opened yet, with a strawberry between its fingers."""
    return make_servo(1020)


@pytest.fixture
def feetech(make_servo: MakeServo) -> Servo:
    """Return a Feetech servo that is not opened yet, with a strawberry in its jaw."""
    return make_servo(777)
