"""One servo line for two programs: palpate drives the gripper, another program the arm.

A half-duplex line has one master. `share_bus` is that master: it gives each program a port of its
own (a pseudo-terminal), passes on one request at a time, and returns the reply to its program.

Run ``python -m palpate.gripper.bus_share /dev/ttyACM0 hand arm`` to share a port until Ctrl-C.
"""

from __future__ import annotations

import argparse
import os
import select
import sys
import threading
import time
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import serial

from palpate.errors import DeviceNotFoundError, InputError, PalpateError
from palpate.gripper.servo_line import PORT_ERRORS
from palpate.sensor.byte_stream import explain_refusal
from palpate.sensor.exclusive_port import claim_port, release_port

assert sys.platform != "win32", "a servo line can be shared on Linux and macOS only"

_HEADER = b"\xff\xff"
_PING, _SYNC_READ = 0x01, 0x82
_BROADCAST = 0xFE
#: Longest wait for the replies to one request. A servo replies within a few milliseconds, and an
#: adapter adds up to 16.
REPLY_S = 0.05
_CHUNK = 4096


def count_replies(packet: bytes) -> int | None:
    """Return the number of replies to a request; None if it is unknown (a broadcast ping).

    `packet`: a complete request of Feetech's protocol.

    >>> count_replies(bytes.fromhex("ffff 06 04 02 38 02 b9")), count_replies(
    ...     bytes.fromhex("ffff fe 06 82 38 02 01 02 3c")
    ... )
    (1, 2)
    """
    number, instruction = packet[2], packet[4]
    if instruction == _SYNC_READ:
        return packet[3] - 4
    if number != _BROADCAST:
        return 1
    return None if instruction == _PING else 0


def split_packets(waiting: bytes) -> tuple[list[bytes], bytes]:
    """Return the complete packets in received bytes, and the rest.

    Bytes before a header are noise, and are dropped.

    >>> split_packets(bytes.fromhex("00 ffff 01 02 01 fb ffff 01"))
    ([b'\\xff\\xff\\x01\\x02\\x01\\xfb'], b'\\xff\\xff\\x01')
    """
    packets: list[bytes] = []
    while (start := waiting.find(_HEADER)) >= 0 and len(waiting) >= start + 4:
        end = start + 4 + waiting[start + 3]
        if len(waiting) < end:
            return packets, waiting[start:]
        packets.append(waiting[start:end])
        waiting = waiting[end:]
    return packets, waiting


def check_names(names: Sequence[Path]) -> None:
    """Raise `InputError` if a port can't have its name.

    A link to a port that no longer exists is of a program that was killed, and is replaced.
    """
    for name in names:
        if name.is_symlink() and name.exists():
            raise InputError(
                f"{name}: is in use as {name.readlink()}; end the program that made it, choose "
                "another name or folder, or delete the link"
            )
        if name.exists():
            raise InputError(f"{name}: is a file; choose another name for the shared port")
        if not name.parent.is_dir():
            raise InputError(f"{name}: no folder {name.parent}; create it")


class _Client:
    """The port of one program: a pseudo-terminal with a stable name."""

    def __init__(self, name: Path) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        # Bytes that no program reads must not block the others.
        os.set_blocking(self.master, False)
        self.name, self.waiting = name, b""
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(self._slave))

    def reply(self, data: bytes) -> None:
        with suppress(BlockingIOError):
            os.write(self.master, data)

    def close(self) -> None:
        self.name.unlink(missing_ok=True)
        os.close(self.master)
        os.close(self._slave)


class SharedBus:
    """The master of a shared line; its thread passes on the requests.

    Parameters
    ----------
    port : str
        The line, e.g. ``"/dev/ttyACM0"``.
    names : sequence of Path
        Names of the programs' ports, which are created as links; see `check_names`.
    baud : int
        Baud rate of the servos. Programs may open their ports with any.
    reply_s : float
        Longest wait for the replies to one request, which another program may have to wait too.

    Attributes
    ----------
    failure : Exception or None
        Why the line was lost; requests are then no longer answered.

    Raises
    ------
    InputError
        If a name belongs to a file or to a port that exists.
    DeviceError
        If the port does not exist or another program uses it.
    """

    def __init__(
        self, port: str, names: Sequence[Path], *, baud: int = 1_000_000, reply_s: float = REPLY_S
    ) -> None:
        check_names(names)
        try:
            self._line = serial.Serial(port, baud, timeout=0, exclusive=True)
        except OSError as error:
            raise explain_refusal(port, error) from error
        claim_port(self._line.fileno())
        self.failure: Exception | None = None
        self._reply_s = reply_s
        self._clients = [_Client(name) for name in names]
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="bus share", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the sharing; repeatable. Servos keep their goals."""
        if not self._thread.is_alive() and self._line.closed:
            return
        os.write(self._waker, b"x")
        self._thread.join()
        for client in self._clients:
            client.close()
        for end in (self._wake, self._waker):
            os.close(end)
        if self.failure is None:
            release_port(self._line.fileno())
        self._line.close()

    def _serve(self) -> None:
        by_master, line = {client.master: client for client in self._clients}, self._line.fileno()
        try:
            while True:
                ready = select.select([*by_master, self._wake, line], [], [])[0]
                if self._wake in ready:
                    return
                if line in ready:
                    # A reply that came too late. Of a lost line, reading fails.
                    self._line.read(_CHUNK)
                # In turn, so that no program keeps the other from the line.
                for master in ready:
                    if master == line:
                        continue
                    client = by_master[master]
                    client.waiting += os.read(master, _CHUNK)
                    requests, client.waiting = split_packets(client.waiting)
                    for request in requests:
                        self._exchange(client, request)
        except PORT_ERRORS as error:
            self.failure = error

    def _exchange(self, client: _Client, request: bytes) -> None:
        # A reply that came too late must not answer this request.
        self._line.reset_input_buffer()
        self._line.write(request)
        missing, received = count_replies(request), b""
        end_s = time.monotonic() + self._reply_s
        while missing != 0:
            left_s = end_s - time.monotonic()
            if left_s <= 0 or not select.select([self._line.fileno()], [], [], left_s)[0]:
                return
            data = self._line.read(_CHUNK)
            if not data:
                raise OSError("the port was disconnected")
            client.reply(data)
            packets, received = split_packets(received + data)
            missing = None if missing is None else max(missing - len(packets), 0)


@contextmanager
def share_bus(
    port: str, names: Sequence[Path], *, baud: int = 1_000_000, reply_s: float = REPLY_S
) -> Iterator[SharedBus]:
    """Share a servo line within a block; see `SharedBus`."""
    bus = SharedBus(port, names, baud=baud, reply_s=reply_s)
    try:
        yield bus
    finally:
        bus.close()


def main() -> None:
    """Share the port of the command line until Ctrl-C.

    Raises `DeviceError` if the line is lost.
    """
    parser = argparse.ArgumentParser(
        prog="bus_share", description="Share a servo line with other programs until Ctrl-C."
    )
    parser.add_argument("port", help="the line, such as /dev/ttyACM0")
    parser.add_argument("names", nargs="+", help="names of the ports to create, such as hand arm")
    given = parser.parse_args()
    with share_bus(given.port, [Path(name) for name in given.names]) as bus:
        sys.stdout.write(f"{given.port} is shared as {' and '.join(given.names)}, until Ctrl-C\n")
        sys.stdout.flush()
        while bus.failure is None:
            time.sleep(0.2)
    raise DeviceNotFoundError(f"{given.port}: {bus.failure}; connect it and start again")


if __name__ == "__main__":
    try:
        main()
    except PalpateError as problem:
        sys.stderr.write(f"bus_share: {problem}\n")
        sys.exit(problem.exit_status)
    except KeyboardInterrupt:
        sys.exit(130)
