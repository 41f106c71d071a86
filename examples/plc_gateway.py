"""What a PLC's gateway does: grasp over HTTP, and put the answer into registers.

Standard library alone, so that it can be copied. Start `palpate serve`, then:

    python examples/plc_gateway.py http://127.0.0.1:8080 A17

`PALPATE_TOKEN` is sent where it is set. Stop from anywhere, whoever drives:

    curl -X POST http://127.0.0.1:8080/api/stop
"""

from __future__ import annotations

import json
import os
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

#: A PLC knows words as numbers; 0 is for what this list does not know.
OUTCOMES = ("", "held", "nothing_there", "slipped", "too_weak", "force_limit", "timed_out")
#: Register by register: the quantity, and how many units of the register make one of its unit.
REGISTERS = {"size_mm": 10, "force_n": 1000, "stiffness_n_per_mm": 1000}
#: What a register holds where nothing was measured. It is never 0, which would be a value.
NOT_MEASURED = -1
POLL_S, PATIENCE_S = 0.05, 120.0


def ask(address: str, method: str, path: str, body: object = None) -> Any:
    """Ask the API; a refusal ends the program with its one line."""
    request = urllib.request.Request(
        f"{address.rstrip('/')}/api{path}",
        method=method,
        data=None if body is None else json.dumps(body).encode(),
        headers={
            "Content-Type": "application/json",
            "Authorization": f"Bearer {os.environ.get('PALPATE_TOKEN', '')}",
        },
    )
    try:
        with urllib.request.urlopen(request, timeout=10) as reply:
            return json.loads(reply.read() or b"null")
    except urllib.error.HTTPError as refused:
        sys.exit(f"{method} {path}: {json.loads(refused.read())['detail']}")


def wait(address: str, reached: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Ask for the state until it is as wanted, and return it."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        state: dict[str, Any] = ask(address, "GET", "/state")
        if reached(state):
            return state
        if time.monotonic() > until_s:
            sys.exit(f"waited {PATIENCE_S:g} s, and it is {state['activity']}: {state['trouble']}")
        time.sleep(POLL_S)


def measure(address: str, item_id: str) -> dict[str, Any]:
    """Grasp what lies between the fingers, give it back, and return the result."""
    ready = wait(address, lambda at: at["activity"] == "watching" and at["fresh"])
    # Whoever stops from now on stops this order too, even if it comes later.
    order = {"item_id": item_id, "stops": ready["stops"]}
    begun = ask(address, "POST", "/grasp", order)
    # The grasp may end by itself: nothing there, slipped, stopped.
    wait(address, lambda at: at["activity"] == "watching" or at["answered"])
    if ask(address, "GET", "/state")["activity"] == "grasping":
        ask(address, "POST", "/release")
        wait(address, lambda at: at["activity"] == "watching")
    result: dict[str, Any] = ask(address, "GET", "/result")
    if result["recording"] != begun["recording"]:
        sys.exit(f"the grasp did not begin: {ask(address, 'GET', '/state')['trouble']}")
    return result


def registers(result: dict[str, Any]) -> list[int]:
    """Return what the PLC reads: the outcome, whether it is simulated, then the quantities."""
    outcome = result["outcome"]
    found = [OUTCOMES.index(outcome) if outcome in OUTCOMES else 0]
    found.append(int(result.get("simulated", False)))
    for name, scale in REGISTERS.items():
        value = (result[name] or {}).get("value")
        found.append(NOT_MEASURED if value is None else round(value * scale))
    return found


if __name__ == "__main__":
    answer = measure(sys.argv[1], sys.argv[2])
    print(answer["verdict"]["text"])
    print("registers", *registers(answer))
