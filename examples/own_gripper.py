"""A custom gripper in one file: implement six small methods to use every grasp.

Hand and sheet are a toy model here, a spring between two plates, so that the file runs anywhere.
Replace `Plates` in `MyGripper` with your bus; keep the sensor, or replace it in the same way. Run:

    python examples/own_gripper.py

For `palpate grasp --rig mine`, register `open_mine` as an entry point in the pyproject.toml of your
package:

    [project.entry-points."palpate.rigs"]
    mine = "my_package.own_gripper:open_mine"
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import palpate
from palpate.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.clock import Clock, ManualClock
from palpate.force.of_calibration import DWELL_S, HORIZON_S
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.rig import Rig
from palpate.sensor.array import RIGID_LAYOUT, Frame

REST_OHM = 9000.0
PADS_MM_PER_N = 0.2


class Plates:
    """Two plates closing on a spring, shared by gripper and sheet."""

    def __init__(self, clock: Clock, *, size_mm: float, n_per_mm: float) -> None:
        self.clock, self.size_mm, self.n_per_mm = clock, size_mm, n_per_mm
        self.start_mm = self.target_mm = 74.0
        self.rate, self.start_s = 1.0, 0.0

    def move(self, target_mm: float, *, rate: float) -> None:
        self.start_mm, self.start_s = self.width_mm, self.clock.now_s()
        self.target_mm, self.rate = target_mm, rate

    @property
    def width_mm(self) -> float:
        travel_mm = self.rate * (self.clock.now_s() - self.start_s)
        low, high = self.start_mm - travel_mm, self.start_mm + travel_mm
        return min(max(self.target_mm, low), high)

    @property
    def force_n(self) -> float:
        return max(0.0, self.size_mm - self.width_mm) / (1 / self.n_per_mm + PADS_MM_PER_N)


class MyGripper:
    """The gripper interface.

    A command contains a target (mm) and a rate (mm/s).
    """

    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)

    def __init__(self, plates: Plates) -> None:
        self.plates = plates

    def state(self) -> GripperState:
        width_mm = self.plates.width_mm
        return GripperState(
            time_s=self.plates.clock.now_s(),
            width_mm=width_mm,
            moving=width_mm != self.plates.target_mm,
        )

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Clamp and send the command; return the sent command, which the grasp uses."""
        sent = replace(
            wanted,
            target=min(max(wanted.target, self.limits.lowest), self.limits.highest),
            rate=min(wanted.rate, self.limits.fastest),
        )
        self.plates.move(sent.target, rate=sent.rate)
        return sent

    def stop(self) -> None:
        """Stop the fingers; the grasp always calls this, so it must not fail."""
        self.plates.move(self.plates.width_mm, rate=1.0)

    def release(self) -> None:
        self.plates.move(self.limits.highest, rate=self.limits.fastest)

    def close(self) -> None:
        """Close the bus; this example has none."""


class MySensor:
    """The sensor interface: frames of counts with sequence number and time."""

    layout = RIGID_LAYOUT

    def __init__(self, plates: Plates, *, period_s: float = 1 / 50) -> None:
        self.plates, self.period_s, self.sequence = plates, period_s, -1
        self.chance = np.random.default_rng(1)

    def read(self, *, timeout_s: float) -> Frame:
        self.plates.clock.sleep_s(min(self.period_s, timeout_s))
        self.sequence += 1
        # A sheet whose conductance rises with the load, in a divider with 4.7 kilohm to ground.
        ohm = REST_OHM / (1 + 2 * self.plates.force_n / self.layout.pixels)
        counts = round(1024 * 4700 / (4700 + ohm))
        # Real readings flicker by one count; constant readings are reported as a broken link.
        flicker = self.chance.integers(-1, 2, size=(self.layout.rows, self.layout.cols))
        return Frame(
            time_s=self.plates.clock.now_s(),
            sequence=self.sequence,
            counts=counts + flicker,
        )

    def close(self) -> None:
        """Close the port; this example has none."""


def my_calibration() -> Calibration:
    """Return a synthetic calibration; on hardware `palpate calibrate` creates it."""
    force_n = np.tile([0.3, 0.6, 1.2, 2.5, 5.0, 10.0], 2)
    rest = np.full((RIGID_LAYOUT.rows, RIGID_LAYOUT.cols), REST_OHM)
    block_n = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
    # Scatter of 2 %, as in the pairs of a real calibration.
    scatter = np.exp(np.tile([0.02, -0.02], 6))
    return Calibration(
        sensor_id="toy",
        origin="simulated",
        layout=RIGID_LAYOUT,
        rest=RestValues(
            ohm=tuple(map(tuple, rest)), spread_percent=tuple(map(tuple, 0 * rest)), frames=100
        ),
        force=ForcePairs(
            run=tuple(range(12)),
            since_move_s=(DWELL_S,) * 6 + (HORIZON_S,) * 6,
            excess=tuple(2 * force_n * scatter),
            relative_percent=tuple(-100 * force_n / (4 + force_n)),
            force_n=tuple(force_n),
        ),
        block=BlockPairs(
            block_mm=(40.0,) * 5,
            width_mm=tuple(40 - PADS_MM_PER_N * block_n + np.tile([0.02, -0.02], 3)[:5]),
            force_n=tuple(block_n),
        ),
    )


def open_mine(*, object_name: str | None = None, seed: int = 0) -> Rig:
    """Open the rig; a real rig ignores both arguments."""
    chance = np.random.default_rng(seed)
    clock = ManualClock()
    plates = Plates(clock, size_mm=chance.uniform(30, 60), n_per_mm=chance.uniform(1, 4))
    return Rig(
        name="mine",
        array=MySensor(plates),
        gripper=MyGripper(plates),
        clock=clock,
        calibration=my_calibration(),
        origin="twin",
        subject=object_name or "spring",
        truth=lambda: {"size_mm": plates.size_mm, "stiffness_n_per_mm": plates.n_per_mm},
    )


def main() -> None:
    """Grasp the spring and compare the result with the truth."""
    rig = open_mine(seed=1)
    plan = palpate.plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=6.0)
    result = palpate.run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
    rig.close()
    truth = rig.truth() if rig.truth else {}
    print(f"{result.outcome} (simulated)")
    for name in ("size_mm", "stiffness_n_per_mm"):
        found = getattr(result, name)
        if found.value is None:  # only a limit of the interval is known, with the reason
            print(f"{name}: {found.status}, {found.reason}; true value {truth[name]:.2f}")
            continue
        print(f"{name}: {found.value:.2f} ({found.low:.2f} to {found.high:.2f})", end="")
        print(f", true value {truth[name]:.2f}")


if __name__ == "__main__":
    main()
