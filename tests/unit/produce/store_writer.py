"""Processes that write grasps to a store, and say each one that was acknowledged on a line."""

from __future__ import annotations

import os
import sys
from datetime import UTC, datetime

from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import Grasp
from palpate.produce.store.outbox import Keeper


def write(where: str, count: int) -> None:
    with Keeper(where) as keeper:
        for number in range(count):
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
            keeper.keep(grasp)
            # Acknowledged: from here on it must not be lost, whatever happens to this process.
            os.write(1, f"{os.getpid()} {grasp.grasp_id}\n".encode())


def main(where: str, processes: int, count: int) -> None:
    children = []
    for _ in range(processes):
        child = os.fork()
        if child == 0:
            write(where, count)
            os._exit(0)
        children.append(child)
    ended = [os.waitpid(child, 0)[1] for child in children]
    sys.exit(any(os.WIFEXITED(status) and os.WEXITSTATUS(status) for status in ended))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
