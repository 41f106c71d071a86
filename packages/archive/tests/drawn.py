"""Archives of drawn holds, and the command as a user runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from palpate.cli import build_app
from palpate.cli import run as run_command
from palpate_archive.catalogue import list_files
from palpate_archive.folders import Folder
from palpate_archive.layout import Archive, Part

DAYS = ("2026-05-01", "2026-05-02")
HOLDS, ROWS = 2, 300


def palpate(*arguments: str) -> int:
    """Run the command; return its exit status."""
    return run_command(build_app(), list(arguments), name="palpate")


def draw_archive(root: Path | str, *, stations: tuple[str, ...] = ("north", "south")) -> Archive:
    """Write an archive of drawn holds: a station's day has two recordings."""
    archive, rng = Archive(root, create=True), np.random.default_rng(3)
    time_s = np.arange(ROWS) / 20
    for station in stations:
        entries = []
        for number, day in enumerate(day for day in DAYS for _ in range(2)):
            source = f"{station}{number}".ljust(12, "0") + "x" * 52
            label = f"{station}{number}-{source[:12]}"
            values = 9000 - 300 * np.log(time_s + rng.uniform(0.2, 1, (HOLDS, 1)))
            columns = {
                "recording": np.full(values.size, label),
                "origin": np.full(values.size, "twin"),
                "hold_id": np.repeat([f"{label}/{hold}" for hold in range(HOLDS)], ROWS),
                "time_s": np.tile(time_s, HOLDS),
                "value": values.ravel(),
                "channel": np.full(values.size, "mean"),
                "unit": np.full(values.size, "ohm"),
            }
            part = Part(kind="holds", station=station, date=day, name=label)
            entries.append(archive.write(part, [pa.table(columns)], sources=[source]))
        archive.catalogue("holds").add(station, entries)
    return archive


def read(address: Path | str, kind: str) -> dict[str, pd.DataFrame]:
    """Return the listed files of a kind: place -> rows."""
    root = str(address)
    return {
        file.removeprefix(f"{root}/"): pq.read_table(
            file.removeprefix("s3://"),
            filesystem=Folder.open(root).fs,
            partitioning=None,
            use_threads=False,
        ).to_pandas()
        for file in list_files(root, kind)
    }


def read_bytes(address: Path | str, kind: str) -> dict[str, bytes]:
    """Return the listed files of a kind: place -> bytes."""
    root = str(address)
    places = [file.removeprefix(f"{root}/") for file in list_files(root, kind)]
    return Folder.open(root).read_all(places)
