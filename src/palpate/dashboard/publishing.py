"""Results and state of the desk to a publisher, while the server runs."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

from palpate.dashboard.desk import Desk
from palpate.dashboard.state_json import state_document

#: What changes faster than this is not published.
_LOOK_S = 0.1


class Publisher(Protocol):
    """Takes documents without making anyone wait."""

    def result(self, document: Mapping[str, object]) -> None:
        """Take how a grasp ended."""
        ...

    def state(self, document: Mapping[str, object]) -> None:
        """Take the state; one that is equal to the last is no news."""
        ...

    def close(self) -> None:
        """Take nothing more."""
        ...


async def publish(desk: Desk, publisher: Publisher) -> None:
    """Publish until this is cancelled."""
    desk.on_result.append(publisher.result)
    with suppress(asyncio.CancelledError):
        while True:
            publisher.state(state_document(desk.session))
            await asyncio.sleep(_LOOK_S)
