"""Pick, carry and place a fruit under force control, in an arm's own loop.

    python examples/pick_and_place.py [RIG]

The rig is simulated by default; give a rig file for a real one.
"""

from __future__ import annotations

import sys

import palpate

#: Frames that the way takes; a real arm moves meanwhile.
WAY_FRAMES = 10


def main(rig_name: str) -> None:
    """Grasp at 2 N, watch the force on the way, and place what is held."""
    with palpate.open_rig(rig_name, seed=1) as rig:
        grip = rig.grasp(target_force_n=2.0)
        print(grip)
        for _ in range(WAY_FRAMES):
            if not grip.is_holding:
                break
            reading = rig.read()
            print(f"{reading.time_s:6.2f} s  {reading.force_n.text(digits=2)} N")
        result = grip.release()
        print(f"{result.outcome}{' (simulated)' if rig.is_simulated else ''}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sim-rigid")
