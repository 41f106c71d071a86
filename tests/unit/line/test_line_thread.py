"""Line protocols run on a separate thread."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from asyncua import Client
from pymodbus.client import AsyncModbusTcpClient
from tests.loop.test_line import OpcUa, free_port, read_registers
from tests.unit.dashboard.test_app_state import app_state_of

from palpate.cli.serve import open_lines
from palpate.dashboard.server import _serve_lines
from palpate.dashboard.transport import LoopThread
from palpate.line import modbus


@pytest.mark.slow
def test_line_protocols_answer_while_the_page_event_loop_is_blocked(tmp_path: Path) -> None:
    opcua_port, modbus_port = free_port(), free_port()
    app = SimpleNamespace(router=SimpleNamespace(on_startup=[], on_shutdown=[]))

    async def read_both_protocols() -> tuple[str, list[int]]:
        async with (
            Client(f"opc.tcp://127.0.0.1:{opcua_port}/palpate") as first,
            AsyncModbusTcpClient("127.0.0.1", port=modbus_port) as second,
        ):
            return await OpcUa(first).value("State"), await read_registers(second, modbus.STATE, 1)

    async def serve_with_blocked_loop() -> tuple[str, list[int]]:
        (start,), (end,) = app.router.on_startup, app.router.on_shutdown
        await start()
        with ThreadPoolExecutor() as pool:
            # Blocks the event loop of the pages until both clients have their answers.
            found = pool.submit(asyncio.run, read_both_protocols()).result()
        await end()
        return found

    with LoopThread("lines") as thread:
        opened = open_lines(
            opcua=str(opcua_port), modbus=str(modbus_port), token=None, folder=tmp_path
        )
        _serve_lines(app, app_state_of(tmp_path), opened, thread=thread)
        assert asyncio.run(serve_with_blocked_loop()) == ("stopped", [0])
