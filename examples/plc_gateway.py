"""A gateway for a PLC: grasp over HTTP, and convert the result to registers.

It uses only the standard library, so the file can be copied. Start `palpate serve`, then run:

    python examples/plc_gateway.py http://127.0.0.1:8080 A17

`PALPATE_TOKEN` is sent if it is set. Any client can stop the hand:

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

#: The number of an outcome is its index, as over Modbus and OPC UA; 0 means another outcome.
OUTCOMES = (
    *("", "held", "nothing_there", "slipped", "too_weak", "force_limit", "timed_out"),
    *("sensor_lost", "gripper_fault", "stopped"),
)
#: Quantity of each register -> register units per unit of the quantity.
REGISTERS = {"size_mm": 10, "force_n": 1000, "stiffness_n_per_mm": 1000}
#: Register value without a measurement; 0 would be a valid value.
NOT_MEASURED = -1
POLL_S, PATIENCE_S = 0.05, 120.0


def ask(address: str, method: str, path: str, body: object = None) -> Any:
    """Send a request to the API; exit with the message of a refusal."""
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


def wait_for_state(address: str, reached: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Poll the state until a condition holds, and return it."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        state: dict[str, Any] = ask(address, "GET", "/state")
        if reached(state):
            return state
        if time.monotonic() > until_s:
            sys.exit(
                f"timed out after {PATIENCE_S:g} s in activity {state['activity']}: "
                f"{state['trouble']}"
            )
        time.sleep(POLL_S)


def measure(address: str, item_id: str) -> dict[str, Any]:
    """Grasp the object between the fingers, release it, and return the result."""
    ready = wait_for_state(address, lambda at: at["state"] == "idle")
    # A stop after this state was read also cancels this order.
    order = {"item_id": item_id, "stops": ready["stops"]}
    started = ask(address, "POST", "/grasp", order)
    # The grasp may end by itself, for example with nothing_there, slipped or stopped.
    at = wait_for_state(address, lambda at: at["state"] != "execute")
    if at["state"] == "holding":
        # Here a line reads at["held"], its numbers and its bin, and moves the item to its place.
        ask(address, "POST", "/release")
        wait_for_state(address, lambda at: at["activity"] == "watching")
    result: dict[str, Any] = ask(address, "GET", "/result")
    if result["recording"] != started["recording"]:
        sys.exit(f"the grasp did not start: {ask(address, 'GET', '/state')['trouble']}")
    return result


def list_registers(result: dict[str, Any]) -> list[int]:
    """Return the registers: outcome, simulated flag, quantities."""
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
    print("registers", *list_registers(answer))
