"""Sends results and the state to a message broker while the server runs."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

from palpate.dashboard.app_state import AppState
from palpate.dashboard.state_json import state_document

#: What changes faster than this is not published.
_LOOK_S = 0.1


class DocumentSink(Protocol):
    """Takes documents without blocking."""

    def result(self, document: Mapping[str, object]) -> None:
        """Take how a grasp ended."""
        ...

    def state(self, document: Mapping[str, object]) -> None:
        """Take the state; one that is equal to the last is no news."""
        ...

    def close(self) -> None:
        """Take nothing more."""
        ...


async def publish(app_state: AppState, publisher: DocumentSink) -> None:
    """Publish until this is cancelled."""
    app_state.on_result.append(publisher.result)
    with suppress(asyncio.CancelledError):
        while True:
            publisher.state(state_document(app_state.session))
            await asyncio.sleep(_LOOK_S)
