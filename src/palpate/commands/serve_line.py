"""`palpate serve --opcua` and `--modbus`: where they listen, and who may come in."""

from __future__ import annotations

import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import DeviceError, InputError

if TYPE_CHECKING:
    from palpate.dashboard.server import LineOpener
    from palpate.line.machine import Line, Machine

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def open_lines(
    *, opcua: str | None, modbus: str | None, token: str | None, folder: Path
) -> list[LineOpener]:
    """Return what opens the protocols that were asked for.

    Raises `InputError` if an address is wrong, or OPC UA would be open to others without a token;
    `DeviceError` if a port is taken.
    """
    openers: list[LineOpener] = []
    if opcua is not None:
        openers.append(_opcua(*_address("--opcua", opcua), token=token, folder=folder))
    if modbus is not None:
        openers.append(_modbus(*_address("--modbus", modbus)))
    return openers


def _address(option: str, text: str) -> tuple[str, int]:
    """Return host and port of ``[HOST:]PORT``; refuse a port that is taken.

    >>> _address("--opcua", "0")
    ('127.0.0.1', 0)
    """
    host, _, port = text.rpartition(":")
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise InputError(f"{option} {text}: give [HOST:]PORT, such as 4840 or 0.0.0.0:4840")
    host = host.strip("[]") or "127.0.0.1"
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Before anything is opened: once the devices are, a fault would leave them running.
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, int(port)))
        except OSError as error:
            raise DeviceError(f"{option} {text}: {error.strerror}; give another") from error
    return host, int(port)


def _opcua(host: str, port: int, *, token: str | None, folder: Path) -> LineOpener:
    from palpate.line.opcua import USER, OpcUaStation

    if host not in _LOOPBACK and not token:
        raise InputError(
            f"--opcua {host}:{port}: others could drive the hand; add --token, the password of "
            f"user {USER}"
        )

    async def opener(machine: Machine) -> Line:
        station = OpcUaStation(machine, password=token, folder=folder)
        at = await station.start(host, port)
        _announce(f"OPC UA at opc.tcp://{host}:{at}/palpate")
        return station

    return opener


def _modbus(host: str, port: int) -> LineOpener:
    from palpate.line.modbus import ModbusStation

    async def opener(machine: Machine) -> Line:
        station = ModbusStation(machine)
        at = await station.start(host, port)
        _announce(f"Modbus TCP at {host}:{at}")
        return station

    return opener


def _announce(text: str) -> None:
    print(f"palpate serve: {text}", file=sys.stderr, flush=True)
