"""The page's end of the pipe to the devices' process: starts it, sends to it, receives from it."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from contextlib import suppress

from palpate.dashboard.device_process import run_devices
from palpate.dashboard.job_context import BenchOpener
from palpate.dashboard.messages import DevicesLost, Update
from palpate.dashboard.orders import Order, Request, Shutdown

#: A grasp that is stopped, a hand that opens: more than this means that the process hangs.
_ENDS_S = 15.0


class DeviceClient:
    """Starts the devices' process, sends to it, and passes on its updates.

    Parameters
    ----------
    on_update : callable
        Called from a thread of its own with every update, and with `Lost` when the process ends.
    benches : dict, optional
        Opens the bench with a load cell, by the rig's name; functions of modules.
    """

    def __init__(
        self,
        on_update: Callable[[Update | DevicesLost], None],
        *,
        benches: dict[str, BenchOpener] | None = None,
    ) -> None:
        # Spawned: a fork of a process with threads may hang.
        context = multiprocessing.get_context("spawn")
        self._on_update = on_update
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=run_devices, args=(theirs, benches or {}), name="palpate-devices"
        )
        self._process.start()
        theirs.close()
        self._sending = threading.Lock()
        self._thread = threading.Thread(target=self._receive, name="receive", daemon=True)
        self._thread.start()

    def send(self, message: Order | Request) -> None:
        """Send an order or a request; does nothing if the process is gone."""
        with self._sending, suppress(OSError):
            self._connection.send(message)

    def close(self) -> None:
        """Stop what runs and end the process."""
        self.send(Shutdown())
        self._process.join(_ENDS_S)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()
        self._thread.join()
        self._connection.close()

    def _receive(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                self._on_update(self._connection.recv())
        self._on_update(
            DevicesLost("the process with the devices has ended; start palpate serve again")
        )
