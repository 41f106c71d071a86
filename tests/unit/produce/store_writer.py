"""Processes that write grasps to a store and print each acknowledged one on a line.

``many STORE PROCESSES COUNT`` writes side by side; ``steps STORE write|send`` kills a process with
``kill -9`` before each of its SQL statements in turn, until one lives to the end.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from itertools import count as count_up

import sqlalchemy as sa

from palpate.errors import StoreAwayError
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import Grasp
from palpate.produce.store import Store


def write(store: Store, number: int) -> None:
    felt = Measurement(value=number, low=number, high=number, unit="n_per_mm")
    grasp = Grasp(
        # Items of their own, and one that all write to.
        item_id=f"of-{os.getpid()}" if number % 2 else "shared",
        taken_at=datetime.now(UTC),
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=Outcome.HELD,
        measurements={"stiffness_n_per_mm": felt},
    )
    store.add_grasp(grasp)
    # Acknowledged: from here on it must not be lost.
    os.write(1, f"{os.getpid()} {grasp.grasp_id}\n".encode())


def write_many(where: str, count: int) -> None:
    with Store.open(where) as store:
        for number in range(count):
            write(store, number)
            # Two that send the same items may get in each other's way: they send again.
            with suppress(StoreAwayError):
                store.send()


def kill_before(step: int) -> None:
    """End this process before its n-th statement, BEGIN and COMMIT included."""
    steps = count_up(1)

    def listen(*_: object) -> None:
        if next(steps) == step:
            os.kill(os.getpid(), signal.SIGKILL)

    for event in ("before_cursor_execute", "commit"):
        sa.event.listen(sa.Engine, event, listen)


def in_child(work: Callable[[], None]) -> int:
    child = os.fork()
    if child == 0:
        work()
        os._exit(0)
    return os.waitpid(child, 0)[1]


def kill_at_every_step(where: str, *, sends: bool) -> None:
    for step in count_up(1):

        def work(step: int = step) -> None:
            with Store.open(where) as store:
                if sends:
                    # What the process before left unsent comes first.
                    store.send()
                    write(store, step)
                kill_before(step)
                if sends:
                    store.send()
                else:
                    write(store, step)

        if os.waitstatus_to_exitcode(in_child(work)) == 0:
            os.write(1, f"steps {step}\n".encode())
            return


def main(mode: str, where: str, *rest: str) -> None:
    if mode == "steps":
        kill_at_every_step(where, sends=rest[0] == "send")
        return
    processes, count = map(int, rest)
    children = []
    for _ in range(processes):
        child = os.fork()
        if child == 0:
            write_many(where, count)
            os._exit(0)
        children.append(child)
    ended = [os.waitpid(child, 0)[1] for child in children]
    sys.exit(any(os.WIFEXITED(status) and os.WEXITSTATUS(status) for status in ended))


if __name__ == "__main__":
    main(*sys.argv[1:])
