"""The client of the device process: orders and requests to it, updates from it."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from contextlib import suppress

from palpate_station.dashboard.device_process import run_devices
from palpate_station.dashboard.messages import DevicesLost, Order, Request, Shutdown, Update

#: Maximum time for the device process to stop a grasp, open the hand and exit, seconds.
_EXIT_TIMEOUT_S = 15.0


class DeviceClient:
    """Starts the device process, sends messages to it, and forwards its updates.

    Parameters
    ----------
    on_update : callable
        Called from a background thread with every update, and with `DevicesLost` at the end.
    """

    def __init__(self, on_update: Callable[[Update | DevicesLost], None]) -> None:
        # Spawned, because a fork of a multithreaded process may deadlock.
        context = multiprocessing.get_context("spawn")
        self._on_update = on_update
        self._connection, child_end = context.Pipe()
        self._process = context.Process(
            target=run_devices, args=(child_end,), name="palpate-devices"
        )
        self._process.start()
        child_end.close()
        self._sending = threading.Lock()
        self._thread = threading.Thread(target=self._receive, name="receive", daemon=True)
        self._thread.start()

    def send(self, message: Order | Request) -> None:
        """Send an order or a request; ignored if the process has ended."""
        with self._sending, suppress(OSError):
            self._connection.send(message)

    def close(self) -> None:
        """Stop the running job and end the process."""
        self.send(Shutdown())
        self._process.join(_EXIT_TIMEOUT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._thread.join()
        self._connection.close()

    def _receive(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                self._on_update(self._connection.recv())
        self._on_update(DevicesLost("the device process has ended; restart palpate serve"))
