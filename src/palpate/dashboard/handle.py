"""The page's end of the pipe to the devices' process."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from contextlib import suppress

from palpate.dashboard.devices import run_devices
from palpate.dashboard.language import Message
from palpate.dashboard.messages import Goodbye, Lost, Order, Update, Urgent
from palpate.dashboard.realtime import put_first
from palpate.dashboard.station import BenchOpener

#: A grasp that is stopped, a hand that opens: more than this means that the process hangs.
_ENDS_S = 15.0


class DeviceProcess:
    """Starts the process; sends to it, and hands on what comes from it.

    Parameters
    ----------
    on_update : callable
        Called from a thread of its own with every update, and with `Lost` when the process ends.
    benches : dict, optional
        Opens the bench with a load cell, by the rig's name; functions of modules.
    realtime : bool
        Whether it comes before all other processes.

    Raises
    ------
    InputError
        If it may not.
    """

    def __init__(
        self,
        on_update: Callable[[Update | Lost], None],
        *,
        benches: dict[str, BenchOpener] | None = None,
        realtime: bool = False,
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
        if realtime and self._process.pid is not None:
            put_first(self._process.pid)
        self._sending = threading.Lock()
        self._thread = threading.Thread(target=self._receive, name="receive", daemon=True)
        self._thread.start()

    def send(self, message: Order | Urgent) -> None:
        """Send an order, or a request that is heard at once; nothing if the process is gone."""
        with self._sending, suppress(OSError):
            self._connection.send(message)

    def close(self) -> None:
        """Stop what runs and end the process."""
        self.send(Goodbye())
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
            Lost(Message("the process with the devices has ended; start palpate serve again"))
        )
