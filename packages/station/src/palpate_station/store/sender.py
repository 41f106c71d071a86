"""A thread that sends the queued records to the shared store."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from palpate.errors import PalpateError, StoreAwayError
from palpate_station.store.database import Store

#: Retry interval after an error if there are no new records, seconds.
_RETRY_S = 10.0
#: Interval of checks whether the shared store answers if there are no new records, seconds.
_CHECK_S = 30.0
#: Maximum wait in `Sender.close`, seconds.
_CLOSE_TIMEOUT_S = 3.0


class Sender:
    """Context manager that sends records in the background until closed.

    `where`: the store, as in `Store.open`.
    `on_error`: called once with each new error message.
    `on_return`: called with one line when the store takes records again.
    """

    def __init__(
        self,
        where: str | Path | None,
        *,
        on_error: Callable[[str], None],
        on_return: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._where, self._on_error, self._on_return = where, on_error, on_return
        #: The error while no records can be sent.
        self.fault: PalpateError | None = None
        #: Time of the last answer, at first of the start, on the monotonic clock.
        self.answered_s = time.monotonic()
        self._wake, self._closing = threading.Event(), False
        self._thread = threading.Thread(target=self._run, name="sender", daemon=True)
        self._thread.start()

    @property
    def away(self) -> StoreAwayError | None:
        """The error while the shared store does not answer."""
        return self.fault if isinstance(self.fault, StoreAwayError) else None

    def wake(self) -> None:
        """Start sending without waiting."""
        self._wake.set()

    def close(self) -> None:
        """Send the remaining records within a time limit; unsent records stay in the file."""
        self._closing = True
        self._wake.set()
        self._thread.join(_CLOSE_TIMEOUT_S)

    def __enter__(self) -> Sender:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _run(self) -> None:
        last = ""
        is_last_round = False
        with ExitStack() as opened:
            store: Store | None = None
            while not is_last_round:
                is_last_round = self._closing
                try:
                    store = store or opened.enter_context(Store.open(self._where))
                    sent = store.send()
                    if not sent:
                        store.check_shared()
                    if last:
                        self._on_return(f"{store.name}: answers again, {sent} records sent")
                    last, self.fault, self.answered_s = "", None, time.monotonic()
                except PalpateError as error:
                    self.fault = error
                    if str(error) != last:
                        self._on_error(f"{error}; the records wait in the local store")
                    last = str(error)
                if not is_last_round:
                    self._wake.wait(_RETRY_S if last else _CHECK_S)
                    self._wake.clear()
