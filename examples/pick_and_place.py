"""Pick, carry and place a fruit under force control, in the loop of an arm.

    python examples/pick_and_place.py [RIG]

The default rig is simulated; give a rig file for real hardware.
"""

from __future__ import annotations

import sys

import palpate

#: Frames of the carrying movement, during which a real arm moves.
CARRY_FRAMES = 10


def main(rig_name: str) -> None:
    """Grasp at 2 N, monitor the force while carrying, and place the object."""
    with palpate.open_rig(rig_name, seed=1) as rig:
        grip = rig.grasp(target_force_n=2.0)
        print(grip)
        for _ in range(CARRY_FRAMES):
            if not grip.is_holding:
                break
            reading = rig.read()
            print(f"{reading.time_s:6.2f} s  {reading.force_n.text(digits=2)} N")
        result = grip.release()
        print(f"{result.outcome}{' (simulated)' if rig.is_simulated else ''}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sim-rigid")
