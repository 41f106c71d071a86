"""The server as machines see it: commands by the rules of the page, results and state sent on."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from palpate.dashboard.app_state import AppState
from palpate.dashboard.loop_thread import run_on
from palpate.dashboard.page_document import state_document
from palpate.errors import InputError
from palpate.line.machine import CommandRefusedError

_Answer = TypeVar("_Answer")
_Asked = ParamSpec("_Asked")
#: A stop that is not confirmed by then is answered so, seconds.
STOP_PATIENCE_S = 2.0


def _on_its_loop(
    command: Callable[Concatenate[Station, _Asked], _Answer],
) -> Callable[Concatenate[Station, _Asked], Coroutine[Any, Any, _Answer]]:
    """Have a command carried out on the loop of the session, whichever loop asks for it."""

    @wraps(command)
    async def carry_out(
        station: Station, /, *args: _Asked.args, **kwargs: _Asked.kwargs
    ) -> _Answer:
        async def work() -> _Answer:
            return command(station, *args, **kwargs)

        loop = station.app_state.loop
        if loop is None:
            raise CommandRefusedError("the devices have not been opened yet")
        return await run_on(loop, work())

    return carry_out


class Station:
    """The commands of one server, from any event loop; see `palpate.line.machine.Machine`."""

    def __init__(self, app_state: AppState) -> None:
        self.app_state, self._session = app_state, app_state.session
        self._results = 0
        app_state.on_result.append(self._count)

    def state(self) -> Mapping[str, Any]:
        """Return the state document."""
        return state_document(self._session)

    def result(self) -> tuple[int, Mapping[str, Any] | None]:
        """Return how many grasps have ended, and the document of the last."""
        return self._results, self.app_state.result

    @_on_its_loop
    def grasp(
        self,
        driver: str,
        *,
        target_force_n: float | None,
        item_id: str,
        kind: str,
        stops: int | None,
    ) -> str:
        """Begin a grasp; return the name of its recording.

        Raises `CommandRefusedError` where it can't begin now, `InputError` for a bad value.
        """
        order = self.app_state.grasp_order(
            target_force_n=target_force_n, item_id=item_id, kind=kind
        )
        with self._session.stop_lock:
            if stops is not None and stops < self._session.stops:
                raise CommandRefusedError(
                    "stopped before it began: ask for the state, then order again"
                )
            self._session.join(driver)
            try:
                self._session.order(driver, order)
            except InputError as error:
                raise CommandRefusedError(str(error)) from error
        return order.recording.name

    @_on_its_loop
    def release(self, driver: str) -> None:
        """Release the object, or open the hand.

        Raises `CommandRefusedError` where it can't be done now.
        """
        self._session.join(driver)
        try:
            self._session.release(driver)
        except InputError as error:
            raise CommandRefusedError(str(error)) from error

    @_on_its_loop
    def take_over(self, driver: str) -> None:
        """Drive from now on."""
        self._session.take_over(driver)

    @_on_its_loop
    def leave(self, driver: str) -> None:
        """Let another client drive."""
        self._session.leave(driver)

    async def stop(self) -> bool:
        """Stop, whoever drives; return whether the devices confirmed it in time."""
        return await self.app_state.stop(patience_s=STOP_PATIENCE_S)

    def _count(self, document: Mapping[str, object]) -> None:
        self._results += 1


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
