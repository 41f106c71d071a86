"""Speed of a store with a million grasps, compared with plain sqlite3.

Run `python benchmarks/store.py --grasps 1000000`; `--store URL` measures PostgreSQL instead (an
empty database). DuckDB on the exported Parquet is measured too if it is installed.
"""

from __future__ import annotations

import argparse
import random
import sqlite3
import tempfile
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate_station.records import MEASURED, About, Grasp, Verdict
from palpate_station.store import Store
from palpate_station.store.export import export_grasps
from palpate_station.store.item_history import read_item_histories, read_item_history

START = datetime(2026, 1, 1, tzinfo=UTC)
PER_ITEM = 20
BULK = 20_000
PAGES = 300
VALUES = {"settled_percent": -30.0, "size_mm": 60.0, "force_n": 2.5, "stiffness_n_per_mm": 4.0}


def invent_grasps(count: int) -> Iterator[Grasp]:
    """Yield grasps of `count / PER_ITEM` items, spread over a season."""
    rng = random.Random(0)
    items = max(1, count // PER_ITEM)
    for k in range(count):
        scale = 1 + 0.1 * rng.random()
        measured = {
            name: Measurement(
                value=value * scale, low=value * 0.9, high=value * 1.2, unit=MEASURED[name]
            )
            for name, value in VALUES.items()
        }
        yield Grasp(
            item_id=f"item-{k % items:06d}",
            taken_at=START + timedelta(seconds=10 * k),
            rig="sim-rigid",
            drive="width",
            origin="twin",
            outcome=Outcome.HELD,
            measurements=measured,
            pixel_settled_percent=((-30.0, -31.5), (-28.0, None), (-33.0, -29.5), (-31.0, -30.0)),
            decision_time_s=1.1,
            peak_force_n=3.0,
            angle_deg=float(90 * (k // items % 4)),
            grasp_id=str(uuid.UUID(int=rng.getrandbits(128), version=4)),
        )


def fill(store: Store, *, grasps: int) -> None:
    started_s = time.perf_counter()
    left = invent_grasps(grasps)
    batch: list[Grasp] = []
    for grasp in left:
        batch.append(grasp)
        if len(batch) == BULK:
            store.add_grasps(batch)
            batch.clear()
    store.add_grasps(batch)
    spent_s = time.perf_counter() - started_s
    rate = grasps / spent_s
    print(f"bulk     {grasps} grasps in {spent_s:.0f} s, {rate:.0f}/s, including their generation")


def measure_single_writes(store: Store, *, count: int = 200) -> None:
    new = [g for g, _ in zip(invent_grasps(2 * count), range(count), strict=False)]
    new = [Grasp(**{**_fields(g), "grasp_id": str(uuid.uuid4())}) for g in new]
    spent_ms = time_each(new, store.add_grasp)
    print(f"single   add_grasp, on the disk when it returns: {_format_times(spent_ms)}")


def measure_pages(store: Store, *, names: list[str]) -> np.ndarray:
    store.add_verdict(Verdict(item_id=names[0], about=About.BIN, text="bin 2", given_at=START))
    spent_ms = time_each(names, lambda name: read_item_history(store, name))
    print(f"page     item, {PER_ITEM} grasps, 4 measurements each: {_format_times(spent_ms)}")
    listed_ms = time_each(range(10), lambda _: read_item_histories(store, store.items(limit=50)))
    print(f"list     the last 50 items with their pages: {_format_times(listed_ms)}")
    return spent_ms


def measure_plain_pages(path: Path, *, names: list[str]) -> np.ndarray:
    """Read the same rows with sqlite3 as tuples, with the same indexes."""
    connection = sqlite3.connect(path)

    def page(name: str) -> None:
        one = (name,)
        connection.execute("SELECT * FROM items WHERE item_id = ?", one).fetchone()
        connection.execute(
            "SELECT * FROM grasps WHERE item_id = ? ORDER BY taken_at", one
        ).fetchall()
        connection.execute(
            "SELECT m.* FROM grasps g JOIN measurements m ON m.grasp_number = g.number "
            "WHERE g.item_id = ?",
            one,
        ).fetchall()
        connection.execute("SELECT * FROM verdicts WHERE item_id = ?", one).fetchall()

    spent_ms = time_each(names, page)
    connection.close()
    return spent_ms


def measure_duckdb_pages(store: Store, folder: Path, *, names: list[str]) -> np.ndarray | None:
    try:
        import duckdb
    except ModuleNotFoundError:
        return None
    path = folder / "grasps.parquet"
    export_grasps(path, store.grasps(), items=store.items())
    # As a number, because DuckDB needs another package for times with a zone.
    query = (
        f"SELECT * REPLACE (epoch_us(taken_at) AS taken_at) FROM '{path}' WHERE item_id = ? "
        "ORDER BY taken_at"
    )
    with duckdb.connect() as connection:
        return time_each(names[:30], lambda name: connection.execute(query, [name]).fetchall())


def time_each(over: Iterable[Any], act: Callable[[Any], object]) -> np.ndarray:
    spent_ms = []
    for one in over:
        started_s = time.perf_counter()
        act(one)
        spent_ms.append(1e3 * (time.perf_counter() - started_s))
    return np.array(spent_ms)


def _fields(grasp: Grasp) -> dict[str, object]:
    return {name: getattr(grasp, name) for name in Grasp.__dataclass_fields__}


def _format_times(spent_ms: np.ndarray) -> str:
    return (
        f"median {np.median(spent_ms):.1f} ms, p99 {np.percentile(spent_ms, 99):.1f} ms, "
        f"longest {spent_ms.max():.1f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--grasps", type=int, default=1_000_000)
    parser.add_argument("--store", help="URL of an empty database [default: a new SQLite file]")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "items.sqlite")
        with Store.open(arguments.store or path) as store:
            fill(store, grasps=arguments.grasps)
            if not arguments.store:
                print(f"file     {path.stat().st_size / arguments.grasps:.0f} bytes per grasp")
            rng = random.Random(1)
            items = max(1, arguments.grasps // PER_ITEM)
            names = [f"item-{rng.randrange(items):06d}" for _ in range(PAGES)]
            palpate_ms = measure_pages(store, names=names)
            measure_single_writes(store)
            peers = {}
            if not arguments.store:
                peers["plain sqlite3, tuples"] = measure_plain_pages(path, names=names)
            peers["DuckDB on Parquet"] = measure_duckdb_pages(store, Path(folder), names=names)
        for peer, peer_ms in peers.items():
            if peer_ms is not None:
                ratio = np.median(palpate_ms) / np.median(peer_ms)
                print(f"peer     {peer}: {_format_times(peer_ms)}; palpate / peer {ratio:.2f}")


if __name__ == "__main__":
    main()
