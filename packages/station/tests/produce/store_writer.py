"""Processes that write grasps to a store and print a line for each acknowledged grasp.

``many STORE PROCESSES COUNT`` writes from several processes at the same time. ``steps STORE
write|send`` kills one process after another with ``kill -9``, each before the next SQL statement,
until a process completes.
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
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate_station.records import Grasp
from palpate_station.store import Store


def write(store: Store, number: int) -> None:
    stiffness = Measurement(value=number, low=number, high=number, unit="n_per_mm")
    grasp = Grasp(
        # Alternate between an item of this process and an item shared by all processes.
        item_id=f"of-{os.getpid()}" if number % 2 else "shared",
        taken_at=datetime.now(UTC),
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=Outcome.HELD,
        measurements={"stiffness_n_per_mm": stiffness},
    )
    store.add_grasp(grasp)
    # The grasp is acknowledged and must not be lost from now on.
    os.write(1, f"{os.getpid()} {grasp.grasp_id}\n".encode())


def write_many(where: str, count: int) -> None:
    with Store.open(where) as store:
        for number in range(count):
            write(store, number)
            # Concurrent senders of the same item may conflict; the next call sends again.
            with suppress(StoreAwayError):
                store.send()


def kill_before(step: int) -> None:
    """Kill this process before its n-th statement, including BEGIN and COMMIT."""
    steps = count_up(1)

    def listen(*_: object) -> None:
        if next(steps) == step:
            os.kill(os.getpid(), signal.SIGKILL)

    for event in ("before_cursor_execute", "commit"):
        sa.event.listen(sa.Engine, event, listen)


def run_in_child(work: Callable[[], None]) -> int:
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
                    # Send the remaining records of the previous process first.
                    store.send()
                    write(store, step)
                kill_before(step)
                if sends:
                    store.send()
                else:
                    write(store, step)

        if os.waitstatus_to_exitcode(run_in_child(work)) == 0:
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
