"""Search of the serial ports for a board with palpate's firmware."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceNotFoundError
from palpate.sensor.board_link import BoardLink
from palpate.sensor.byte_stream import ByteStream, SerialStream
from palpate.sensor.wire_messages import BoardIdentity, Identify

_ARDUINO = "Arduino"
#: Board of each USB vendor. For generic USB bridge chips the product id is compared too.
_VENDORS = {0x2341: _ARDUINO, 0x2A03: _ARDUINO}
_BRIDGES = {
    (0x1A86, 0x7523): "CH340, as on many Arduino clones",
    (0x1A86, 0x55D4): "CH9102, as on some Arduino clones",
    (0x0403, 0x6001): "FTDI FT232",
    (0x10C4, 0xEA60): "CP210x",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """One serial port of this machine."""

    #: Device name, e.g. ``"/dev/ttyACM0"``.
    device: str
    #: Description from the operating system.
    description: str
    #: Vendor and product.
    usb_id: tuple[int, int] | None = None
    #: Serial number of the USB device, which distinguishes two boards.
    serial_number: str | None = None
    #: Place on the USB tree, e.g. "1-1.2:1.0"; it distinguishes boards without a serial number.
    location: str | None = None
    #: Board or chip that the USB id suggests; None if unknown.
    board: str | None = None


def identify_board(usb_id: tuple[int, int] | None) -> str | None:
    """Return the probable board or chip of a USB id; None if unknown.

    >>> identify_board((0x2341, 0x0042)), identify_board((0x1A86, 0x7523)), identify_board(None)
    ('Arduino', 'CH340, as on many Arduino clones', None)
    """
    if usb_id is None:
        return None
    return _VENDORS.get(usb_id[0]) or _BRIDGES.get(usb_id)


def list_serial_ports() -> list[Port]:
    """Return the serial ports of this machine, with probable boards first.

    A system without pyserial's modules has none.
    """
    try:
        from serial.tools.list_ports import comports
    except ImportError:
        return []
    ports = []
    for found in comports():
        usb_id = None if found.vid is None or found.pid is None else (found.vid, found.pid)
        ports.append(
            Port(
                device=found.device,
                description="" if found.description in (None, "n/a") else found.description,
                usb_id=usb_id,
                serial_number=found.serial_number,
                location=found.location,
                board=identify_board(usb_id),
            )
        )
    return sorted(ports, key=lambda port: (port.board is None, port.board != _ARDUINO, port.device))


def find_port(
    ports: Sequence[Port],
    *,
    clock: Clock,
    open_stream: Callable[[str], ByteStream] = SerialStream,
) -> str:
    """Find the port of the only board, from its USB id or its answer.

    Raises `DeviceNotFoundError` if there is no board; `DeviceError` if several boards answer.
    """
    likely = [port for port in ports if port.board is not None]
    if len(likely) == 1:
        return likely[0].device
    candidates = likely or list(ports)
    errors: list[str] = []
    answering: list[str] = []
    for port in candidates:
        try:
            query_identity(open_stream(port.device), clock=clock)
            answering.append(port.device)
        except DeviceError as error:
            errors.append(str(error))
    if len(answering) == 1:
        return answering[0]
    if answering:
        raise DeviceError(
            f"{len(answering)} boards answer: {', '.join(answering)}; choose one with --port"
        )
    if not candidates:
        raise DeviceNotFoundError("no serial port found on this machine; plug in the board")
    raise DeviceNotFoundError(f"no board answers: {errors[0]}")


def make_port_finder(
    device: str, *, list_ports: Callable[[], Sequence[Port]] = list_serial_ports
) -> Callable[[], str]:
    """Return a function that finds the current port of the board now at `device`.

    A replugged board can get another port name, but its USB serial number does not change. A board
    without a number of its own is found in the same USB socket. The function raises
    `DeviceNotFoundError` rather than return the port of another board.

    >>> before = [Port(device="/dev/ttyUSB0", description="CH340", location="1-1.2")]
    >>> after = [Port(device="/dev/ttyUSB1", description="CH340", location="1-1.2")]
    >>> seen = iter([before, after])
    >>> make_port_finder("/dev/ttyUSB0", list_ports=lambda: next(seen))()
    '/dev/ttyUSB1'
    """
    before = list_ports()
    known = {port.device: port for port in before}.get(device)
    # Some makers give all their boards the same number, and so do the interfaces of one adapter.
    alike = [
        port
        for port in before
        if known is not None
        and (port.usb_id, port.serial_number) == (known.usb_id, known.serial_number)
    ]

    def find_current_port() -> str:
        if known is None or not (known.serial_number or known.location):
            return device  # a link with a fixed name, or no USB device
        equal = [
            port
            for port in list_ports()
            if (port.usb_id, port.serial_number) == (known.usb_id, known.serial_number)
        ]
        in_place = [port for port in equal if port.location == known.location]
        if known.serial_number and len(equal) == len(alike) == 1:
            return equal[0].device
        if known.location and len(in_place) == 1:
            return in_place[0].device
        raise DeviceNotFoundError(f"the board at {device} is not back in its USB socket")

    return find_current_port


def query_identity(stream: ByteStream, *, clock: Clock) -> BoardIdentity:
    """Return the identity of the board at a port, and close the port.

    Raises `DeviceError` if the board does not answer with palpate's protocol.
    """
    try:
        link = BoardLink(stream, clock=clock)
        link.execute(Identify())
        if link.identity is None:
            raise DeviceError(f"{stream.name}: the board did not identify itself")
        return link.identity
    finally:
        stream.close()
