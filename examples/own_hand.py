"""A guard and a grasp with any object that moves: `width_mm`, `move` and `stop`.

Hand and sheet are the toy model of own_gripper.py, by the wall clock. Replace the body of `MyHand`
with your bus, and the sensor with your rig file: `palpate.open_rig("sensor.toml", gripper=hand)`.

    python examples/own_hand.py
"""

from __future__ import annotations

import time

import palpate
from own_gripper import MySensor, Plates, my_calibration
from palpate.clock import RealClock


class MyHand:
    """A gripper as its maker's library offers it."""

    lowest_mm, highest_mm, fastest_mm_s = 5.0, 74.0, 60.0

    def __init__(self, plates: Plates) -> None:
        self.plates = plates

    @property
    def width_mm(self) -> float:
        return self.plates.width_mm

    def move(self, width_mm: float, speed_mm_s: float) -> None:
        self.plates.move(width_mm, rate=speed_mm_s)

    def stop(self) -> None:
        self.plates.move(self.plates.width_mm, rate=1.0)


def main() -> None:
    """Close under guard, then grasp."""
    plates = Plates(RealClock(), size_mm=40.0, n_per_mm=2.0)
    hand, sensor = MyHand(plates), MySensor(plates)
    with palpate.open_rig(array=sensor, gripper=hand, calibration=my_calibration()) as rig:
        with palpate.ForceGuard(rig, limit_n=3.0) as guard:
            hand.move(20.0, 10.0)
            guard.wait(60.0)
            print(f"stopped at {plates.force_n:.1f} N (simulated): {guard.reason}")
        hand.move(74.0, 60.0)
        time.sleep(1.5)
        result = rig.grasp(target_force_n=2.0).release()
        print(f"{result.outcome} (simulated)")


if __name__ == "__main__":
    main()
