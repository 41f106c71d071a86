"""A user's script: close the hand in small steps, and stop at 3 N.

``python user_guard.py MODE``: it reads at every "frame", once a "second", or with a "pause" of 2 s
after every fifth step; or a `ForceGuard` reads in a "thread". It prints the monotonic time of the
stop and the last reading.
"""

import json
import sys
import time

import palpate
from palpate.gripper.interface import GripperCommand

LIMIT_N, START_MM, STEP_MM, LEAST_MM = 3.0, 32.5, 0.06, 24.0


def close_with_a_guard(rig):
    """Close until the guard stops the hand; return the time of the stop and the last reading."""
    with palpate.ForceGuard(rig, limit_n=LIMIT_N) as guard:
        width = START_MM
        while not guard.is_tripped:
            width -= STEP_MM
            if width < LEAST_MM:
                sys.exit(f"the hand is at {width:.1f} mm and the guard reads {guard.reading!r}")
            rig.gripper.command(GripperCommand(target=width, rate=5.0))
            guard.wait(0.2)
        if "below the limit" not in guard.reason:
            sys.exit(guard.reason)
        return guard.tripped_s, guard.reading


def main():
    mode = sys.argv[1]
    with palpate.open_rig("rig.toml") as rig:
        width, steps, ages = START_MM, 0, []
        rig.gripper.command(GripperCommand(target=width, rate=20.0))
        # The hand stops by itself if nobody speaks with it.
        while rig.gripper.state().moving:
            time.sleep(0.05)
        moved_s = time.monotonic()
        if mode == "thread":
            stop_s, reading = close_with_a_guard(rig)
            ages.append(reading.age_s)
        while mode != "thread":
            reading = rig.read()
            ages.append(time.monotonic() - reading.time_s)
            if reading.force_n.high > LIMIT_N:
                rig.gripper.stop()
                stop_s = time.monotonic()
                break
            rig.gripper.state()
            if mode != "second" and time.monotonic() - moved_s < 0.2:
                continue
            if width < LEAST_MM:
                sys.exit(f"the hand is at {width:.1f} mm and the guard reads {reading!r}")
            width -= STEP_MM
            steps += 1
            rig.gripper.command(GripperCommand(target=width, rate=5.0))
            moved_s = time.monotonic()
            if mode == "second":
                time.sleep(1.0)
            elif mode == "pause" and steps % 5 == 0:
                time.sleep(2.0)
        print(
            json.dumps(
                {
                    "stop_s": stop_s,
                    "high_n": reading.force_n.high,
                    "value_n": reading.force_n.value,
                    "age_s": max(ages),
                }
            ),
            flush=True,
        )
        sys.stdin.read()


if __name__ == "__main__":
    main()
