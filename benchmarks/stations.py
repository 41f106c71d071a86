"""Fifty stations write to one PostgreSQL store: lost records, and time per write.

    python benchmarks/stations.py --stations 50 --seconds 600 --every 5

Starts a private server with its durable defaults (requires Debian's `postgresql`), and one process
per station. A station writes a synthetic grasp at each period, or with `--every 0` without pauses.
After half of the time, all database connections are terminated once. The exit status is 1 if an
acknowledged grasp is missing.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import uuid
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from palpate.errors import PalpateError
from palpate_station.store import Store
from palpate_station.store.sender import Sender
from services import Database, run_service
from store import invent_grasps

TEMPLATES = 200
SIZE = "SELECT pg_database_size('postgres')"
TERMINATE = (
    "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity "
    "WHERE pid <> pg_backend_pid() AND backend_type = 'client backend'"
)


def run_station(
    url: str, number: int, *, folder: Path, until_s: float, every_s: float
) -> tuple[list[str], list[str], list[float]]:
    """Write grasps until a time; return acknowledged and refused ids, and times in ms."""
    os.environ["XDG_STATE_HOME"] = str(folder / f"station-{number}")
    rng = np.random.default_rng(number)
    templates = list(invent_grasps(TEMPLATES))
    acknowledged, refused, spent_ms = list[str](), list[str](), list[float]()
    due_s = time.time() + every_s * rng.random()
    with Store.open(url) as store, Sender(url, on_error=print) as sender:
        while time.time() < until_s:
            time.sleep(max(due_s - time.time(), 0.0))
            due_s += every_s
            grasp = replace(
                templates[rng.integers(TEMPLATES)],
                grasp_id=str(uuid.uuid4()),
                item_id=f"station-{number}-{len(spent_ms) // 4}",
            )
            started_s = time.perf_counter()
            try:
                store.add_grasp(grasp)
                acknowledged.append(grasp.grasp_id)
                sender.wake()
            except PalpateError:
                refused.append(grasp.grasp_id)
            spent_ms.append(1e3 * (time.perf_counter() - started_s))
        sender.close()
        store.send()
    return acknowledged, refused, spent_ms


def query_number(url: str, question: str) -> int:
    """Run a query that returns one number."""
    import sqlalchemy

    engine = sqlalchemy.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect() as connection:
        found = int(connection.execute(sqlalchemy.text(question)).scalar_one())
    engine.dispose()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stations", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--every", type=float, default=5.0, help="period of the grasps, seconds")
    options = parser.parse_args()
    with ExitStack() as stack:
        place = stack.enter_context(tempfile.TemporaryDirectory())
        database = Database(Path(place))
        stack.enter_context(run_service(database))
        url = database.url
        os.environ["XDG_STATE_HOME"] = place
        empty = query_number(url, SIZE)
        with get_context("spawn").Pool(options.stations) as pool:
            # Wait until every process has started.
            pool.map(os.path.exists, ["/"] * options.stations, chunksize=1)
            until_s = time.time() + options.seconds
            settings = {"folder": Path(place), "until_s": until_s, "every_s": options.every}
            running = [
                pool.apply_async(run_station, (url, number), settings)
                for number in range(options.stations)
            ]
            time.sleep(options.seconds / 2)
            cuts = query_number(url, TERMINATE)
            ended = [one.get() for one in running]
        acknowledged_ids = {name for names, _, _ in ended for name in names}
        refused = {name for _, names, _ in ended for name in names}
        with Store.open(url) as store:
            stored_ids = {grasp.grasp_id for grasp in store.grasps()}
        grown = query_number(url, SIZE) - empty
    spent_ms = np.array([ms for _, _, each in ended for ms in each])
    print(
        f"{options.stations} stations, {options.seconds:g} s, a grasp every {options.every:g} s; "
        f"{cuts} connections terminated at half time"
    )
    print(
        f"{len(acknowledged_ids)} grasps acknowledged, "
        f"{len(acknowledged_ids - stored_ids)} of them missing; "
        f"{len(refused)} refused, {len(refused & stored_ids)} of them stored"
    )
    print(
        f"a write: median {np.median(spent_ms):.1f} ms, p99 {np.percentile(spent_ms, 99):.1f} ms, "
        f"longest {spent_ms.max():.0f} ms; {len(spent_ms) / options.seconds:.0f} a second"
    )
    print(f"{grown / len(stored_ids) * 1e6 / 1e9:.2f} GB per million grasps")
    sys.exit(bool(acknowledged_ids - stored_ids))


if __name__ == "__main__":
    main()
