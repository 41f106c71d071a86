"""`palpate ports`: the serial ports of this machine, and which look like a board."""

from __future__ import annotations

from dataclasses import asdict

from palpate.cli.options import JsonOption
from palpate.cli.output import print_json
from palpate.sensor.ports import serial_ports


def ports(
    as_json: JsonOption = False,
) -> None:
    """List serial ports, likely boards first.

    Example: palpate ports
    """
    found = serial_ports()
    if as_json:
        print_json({"ports": [asdict(port) for port in found]})
        return
    if not found:
        print("no serial port on this machine; plug the board in")
    for port in found:
        usb = "" if port.usb_id is None else f"{port.usb_id[0]:04x}:{port.usb_id[1]:04x}"
        mark = f"<- {port.board}" if port.board else ""
        print(f"{port.device:<16} {usb:<10} {port.description} {mark}".rstrip())
