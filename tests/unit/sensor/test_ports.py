"""The port of a replugged board, from its USB number or USB socket."""

from __future__ import annotations

import pytest

from palpate.errors import DeviceNotFoundError
from palpate.sensor.ports import Port, make_port_finder

CH340, CP2102 = (0x1A86, 0x7523), (0x10C4, 0xEA60)


def port(
    name: str, socket: str | None, *, number: str | None = None, usb_id: tuple[int, int] = CH340
) -> Port:
    return Port(
        device=f"/dev/{name}",
        description="USB serial",
        usb_id=usb_id,
        serial_number=number,
        location=socket,
    )


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        # Equal numbers: the other board alone, and the other interface of one adapter.
        (
            [port("USB0", "1-1", number="0001"), port("USB1", "1-2", number="0001")],
            [port("USB0", "1-2", number="0001")],
            None,
        ),
        (
            [port("USB0", "1-1:1.1", number="FT1"), port("USB1", "1-1:1.0", number="FT1")],
            [port("USB2", "1-1:1.0", number="FT1")],
            None,
        ),
        # Without a number: the USB socket decides.
        ([port("USB0", "1-1")], [port("USB1", "1-1")], "USB1"),
        (
            [port("USB0", "1-1"), port("USB1", "1-2")],
            [port("USB2", "1-1"), port("USB1", "1-2")],
            "USB2",
        ),
        # Both boards were replugged, and their names exchanged.
        (
            [port("USB0", "1-1"), port("USB1", "1-2")],
            [port("USB0", "1-2"), port("USB1", "1-1")],
            "USB1",
        ),
        # Only the other board is back, under this board's name.
        ([port("USB0", "1-1"), port("USB1", "1-2")], [port("USB0", "1-2")], None),
        # Another kind of board in this socket.
        ([port("USB0", "1-1")], [port("USB0", "1-1", usb_id=CP2102)], None),
        ([port("USB0", "1-1")], [], None),
        # With a number: any socket.
        (
            [port("USB0", "1-1", number="7")],
            [port("USB0", "1-1", number="8"), port("USB1", "1-4", number="7")],
            "USB1",
        ),
        ([port("USB0", "1-1", number="7")], [port("USB0", "1-1", number="8")], None),
        # Two boards with the number 0001, as many CP2102 have.
        (
            [port("USB0", "1-1", number="1"), port("USB1", "1-2", number="1")],
            [port("USB0", "1-2", number="1"), port("USB1", "1-1", number="1")],
            "USB1",
        ),
        # No USB device, or a link in /dev with a fixed name.
        ([port("USB0", None)], [], "USB0"),
        ([port("USB1", "1-1")], [port("USB2", "1-1")], "USB0"),
    ],
)
def test_port_finder_finds_the_same_board_or_none(
    before: list[Port], after: list[Port], found: str | None
) -> None:
    now = before
    find_current_port = make_port_finder("/dev/USB0", list_ports=lambda: now)
    now = after
    if found is None:
        with pytest.raises(DeviceNotFoundError, match="not back in its USB socket"):
            find_current_port()
    else:
        assert find_current_port() == f"/dev/{found}"
