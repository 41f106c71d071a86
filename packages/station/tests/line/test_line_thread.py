"""Line protocols run on a separate thread, and beyond the loopback with token and encryption."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import TypeVar

import pytest
from asyncua import Client, ua
from packages.station.tests.dashboard.test_app_state import app_state_of
from packages.station.tests.loop.test_line import OpcUa, free_port, read_registers
from pymodbus.client import AsyncModbusTcpClient

from palpate_station.cli.serve import open_lines
from palpate_station.dashboard.server import _serve_lines
from palpate_station.dashboard.transport import LoopThread
from palpate_station.line import modbus

pytestmark = pytest.mark.slow
TOKEN = "correct-horse-battery"
_Found = TypeVar("_Found")


def serve_lines(folder: Path, visit: Callable[[], _Found], **addresses: str | None) -> _Found:
    """Serve the protocols on a thread of their own while the visit blocks the page's loop."""
    app = SimpleNamespace(router=SimpleNamespace(on_startup=[], on_shutdown=[]))

    async def serve_with_blocked_loop() -> _Found:
        (start,), (end,) = app.router.on_startup, app.router.on_shutdown
        await start()
        try:
            with ThreadPoolExecutor() as pool:
                return pool.submit(visit).result()
        finally:
            await end()

    with LoopThread("lines") as thread:
        opened = open_lines(folder=folder, **addresses)
        _serve_lines(app, app_state_of(folder), opened, thread=thread)
        return asyncio.run(serve_with_blocked_loop())


def test_line_protocols_answer_while_the_page_event_loop_is_blocked(tmp_path: Path) -> None:
    opcua_port, modbus_port = free_port(), free_port()

    async def read_both_protocols() -> tuple[str, list[int]]:
        async with (
            Client(f"opc.tcp://127.0.0.1:{opcua_port}/palpate") as first,
            AsyncModbusTcpClient("127.0.0.1", port=modbus_port) as second,
        ):
            return await OpcUa(first).value("State"), await read_registers(second, modbus.STATE, 1)

    addresses = {"opcua": str(opcua_port), "modbus": str(modbus_port), "token": None}
    found = serve_lines(tmp_path, lambda: asyncio.run(read_both_protocols()), **addresses)
    assert found == ("stopped", [0])


def test_opcua_beyond_the_loopback_requires_token_and_encryption(tmp_path: Path) -> None:
    port = free_port()

    async def visit(password: str, *, encrypted: bool) -> str:
        client = Client(f"opc.tcp://127.0.0.1:{port}/palpate")
        client.set_user("palpate")
        client.set_password(password)
        client.application_uri = "urn:example:client"
        if encrypted:
            await client.set_security_string(
                f"Basic256Sha256,SignAndEncrypt,{tmp_path}/opcua-certificate.der,"
                f"{tmp_path}/opcua-key.pem"
            )
        async with client:
            found: str = await OpcUa(client).value("State")
            return found

    def visit_all() -> str:
        for password, encrypted in (("wrong", True), (TOKEN, False)):
            with pytest.raises((ua.UaError, ConnectionError, asyncio.TimeoutError)):
                asyncio.run(visit(password, encrypted=encrypted))
        return asyncio.run(visit(TOKEN, encrypted=True))

    addresses = {"opcua": f"0.0.0.0:{port}", "modbus": None, "token": TOKEN}
    assert serve_lines(tmp_path, visit_all, **addresses) == "stopped"
