"""A simulated shift on a line: OPC UA and Modbus clients grasp items.

Run `python benchmarks/line_shift.py --items 50`. Each client in turn commands grasps and releases,
and compares every result with that of HTTP. The output is the number of different results, the time
from the end of a grasp (as reported by the server) to the client, and the load of the machine. The
OPC UA client has its default watchdog, which closes a connection that is silent for 1 s.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import struct
import sys
import tempfile
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from asyncua import Client
from packages.station.tests.loop.test_line import OpcUa, free_port, reach, read_registers
from packages.station.tests.served_pages import SIMULATED, Machine, serve_dashboard
from pymodbus.client import AsyncModbusTcpClient

from palpate_station.line import modbus
from palpate_station.line.machine import LineState
from palpate_station.line.results import list_measurements

#: Polling period of a client, seconds.
POLL_S = 0.01


def print_results(name: str, differ: int, late_ms: list[float]) -> None:
    p50, p99 = np.quantile(late_ms, [0.5, 0.99])
    print(
        f"{name}: {len(late_ms)} results, {differ} differ from HTTP; end of grasp to client "
        f"p50 {p50:.0f} ms, p99 {p99:.0f} ms, longest {max(late_ms):.0f} ms; "
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
        flush=True,
    )


def age_ms(document: dict[str, Any]) -> float:
    return 1e3 * (time.time() - datetime.fromisoformat(document["ended_at"]).timestamp())


async def shift_over_opcua(address: str, machine: Machine, *, items: int) -> None:
    differ, late_ms = 0, []
    async with Client(address) as client:
        hand = OpcUa(client)
        await hand.call("TakeOver")
        for number in range(items):
            await hand.reach("idle")
            before = await hand.value("Result", "Number")
            await hand.grasp(2.0, f"opcua-{number}")
            await hand.reach("holding")
            await hand.call("Release")
            while await hand.value("Result", "Number") == before:
                await asyncio.sleep(POLL_S)
            found = json.loads(await hand.value("Result", "Document"))
            late_ms.append(age_ms(found))
            differ += machine.ask("GET", "/result")[1] != found
    print_results("OPC UA", differ, late_ms)


async def shift_over_modbus(port: int, machine: Machine, *, items: int) -> None:
    differ, late_ms = 0, []
    async with AsyncModbusTcpClient("127.0.0.1", port=port) as client:
        await client.write_register(modbus.COMMAND, modbus.TAKE_OVER)
        for number in range(items):
            await reach(client, LineState.IDLE)
            before = await read_registers(client, modbus.RESULTS, 2)
            await client.write_register(modbus.TARGET, 200)
            item = f"modbus-{number}"
            await client.write_registers(modbus.NEW_ITEM, modbus.encode_text(item))
            await client.write_register(modbus.COMMAND, modbus.GRASP)
            await reach(client, LineState.HOLDING)
            await client.write_register(modbus.COMMAND, modbus.RELEASE)
            while await read_registers(client, modbus.RESULTS, 2) == before:
                await asyncio.sleep(POLL_S)
            seen = time.time()
            words = await read_registers(client, modbus.VALUES, 30)
            named = modbus.decode_text(
                await read_registers(client, modbus.ITEM, modbus.TEXT_REGISTERS)
            )
            document = machine.ask("GET", "/result")[1]
            late_ms.append(age_ms(document) - 1e3 * (time.time() - seen))
            wanted = np.array(list_measurements(document), dtype=np.float32)
            values = np.array(struct.unpack(">15f", struct.pack(">30H", *words)), dtype=np.float32)
            is_same = np.array_equal(values, wanted, equal_nan=True) and named == item
            differ += not (is_same and document["item_id"] == item)
    print_results("Modbus TCP", differ, late_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--items", type=int, default=50, help="of each client")
    options = parser.parse_args()
    opcua, modbus_port = free_port(), free_port()
    serve = (*SIMULATED, "--opcua", str(opcua), "--modbus", str(modbus_port))
    with tempfile.TemporaryDirectory() as folder, serve_dashboard(Path(folder), *serve) as address:
        machine = Machine(address)
        at = f"opc.tcp://127.0.0.1:{opcua}/palpate"
        asyncio.run(shift_over_opcua(at, machine, items=options.items))
        asyncio.run(shift_over_modbus(modbus_port, machine, items=options.items))


if __name__ == "__main__":
    main()
