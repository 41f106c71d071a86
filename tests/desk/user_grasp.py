"""A user's script: grasp again and again, with a new object at each line of the standard input.

It prints a line of JSON for each grasp: the result, and the age of each reading of the hold.
"""

import json
import sys
import time

import palpate


def main():
    with palpate.open_rig("rig.toml") as rig:
        for _ in sys.stdin:
            begin_s = time.monotonic()
            grip = rig.grasp()
            held, ages = grip.is_holding, []
            until_s = time.monotonic() + 1.0
            while grip.is_holding and time.monotonic() < until_s:
                ages.append(time.monotonic() - grip.read().time_s)
            grip.release()
            document = grip.to_dict()
            document["still_held"] = held and bool(ages)
            document["begin_s"], document["hold_age_s"] = begin_s, max(ages, default=None)
            print(json.dumps(document), flush=True)


if __name__ == "__main__":
    main()
