"""Ports: the port of a replugged board, a claim for one program, and the latency of an adapter."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from tests.pty_port import open_elsewhere

from palpate.errors import DeviceNotFoundError
from palpate.sensor.exclusive_port import claim_port, release_port
from palpate.sensor.ports import Port, make_port_finder
from palpate.sensor.usb_latency import explain_latency, latency_timer_ms

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


def test_claimed_port_is_busy_for_others_until_it_is_released() -> None:
    master, slave = os.openpty()
    os.chmod(os.ttyname(slave), 0o666)
    claim_port(slave)
    busy = open_elsewhere(os.ttyname(slave))
    release_port(slave)
    free = open_elsewhere(os.ttyname(slave))
    for end in (master, slave):
        os.close(end)
    assert (busy, free) == (errno.EBUSY, 0)


def write_timer(sysfs: Path, device: str, text: str) -> Path:
    timer = sysfs / "bus/usb-serial/devices" / device / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(text)
    return timer


def test_slow_timer_is_explained_with_its_own_path_through_a_link(tmp_path: Path) -> None:
    timer = write_timer(tmp_path, "ttyUSB7", "16\n")
    link = tmp_path / "usb-FTDI_U2D2-if00-port0"
    link.symlink_to("/dev/ttyUSB7")
    assert latency_timer_ms(str(link), sysfs=tmp_path) == 16
    text = explain_latency(str(link), sysfs=tmp_path)
    assert "16 ms" in text
    assert str(timer) in text
    timer.write_text("1\n")
    assert explain_latency(str(link), sysfs=tmp_path) is None


@pytest.mark.parametrize("text", ["", "fast\n", "\xff"])
def test_unreadable_timer_is_unknown(text: str, tmp_path: Path) -> None:
    write_timer(tmp_path, "ttyUSB0", text)
    assert latency_timer_ms("/dev/ttyUSB0", sysfs=tmp_path) is None
    assert explain_latency("/dev/ttyUSB0", sysfs=tmp_path) is None
