"""A user's script: close the hand in small steps, and stop at 3 N.

``python user_guard.py MODE``: it reads once a frame, once a second, or after pauses of 2 s.
It prints the monotonic time of the stop and the last reading.
"""

import json
import sys
import time

import palpate
from palpate.gripper.interface import GripperCommand

LIMIT_N = 3.0
mode = sys.argv[1]
with palpate.open_rig("rig.toml") as rig:
    rig.gripper.command(GripperCommand(target=33.0, rate=20.0))
    time.sleep(3.0)
    width, reads, ages = 33.0, 0, []
    moved_s = time.monotonic()
    while True:
        reading = rig.read()
        reads += 1
        ages.append(time.monotonic() - reading.time_s)
        if reading.force_n.high > LIMIT_N:
            rig.gripper.stop()
            stop_s = time.monotonic()
            break
        if width < 20.0:
            sys.exit("the hand is at 20 mm, and the guard has not stopped it")
        if mode == "frame":
            if time.monotonic() - moved_s < 0.2:
                continue
        elif mode == "second":
            time.sleep(max(1.0 - (time.monotonic() - moved_s), 0.0))
        elif reads % 10 == 0:
            time.sleep(2.0)
        elif reads % 10:
            continue
        width -= 0.06
        rig.gripper.command(GripperCommand(target=width, rate=5.0))
        rig.gripper.state()
        moved_s = time.monotonic()
    print(
        json.dumps(
            {
                "stop_s": stop_s,
                "reads": reads,
                "high_n": reading.force_n.high,
                "value_n": reading.force_n.value,
                "age_s": max(ages),
            }
        )
    )
    time.sleep(0.3)
