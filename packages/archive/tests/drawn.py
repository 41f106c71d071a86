"""Archives of drawn holds, and the command as a user runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from palpate.cli import build_app
from palpate.cli import run as run_command
from palpate_archive.catalogue import Catalogue, Part, list_files
from palpate_archive.folders import Folder
from palpate_archive.layout import open_archive, write_tables

DAYS = ("2026-05-01", "2026-05-02")
HOLDS, ROWS = 2, 300


def palpate(*arguments: str) -> int:
    """Run the command; return its exit status."""
    return run_command(build_app(), list(arguments), name="palpate")


def draw_archive(root: Path | str, *, stations: tuple[str, ...] = ("north", "south")) -> Folder:
    """Write an archive of drawn holds: a station's day has two recordings."""
    archive, rng = open_archive(root, create=True), np.random.default_rng(3)
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
            place = Part("holds", station, day, label).place
            entries.append(write_tables(archive, place, [pa.table(columns)], sources=[source]))
        Catalogue(archive, "holds").add(entries)
    return archive


def read(address: Path | str, kind: str) -> dict[str, pd.DataFrame]:
    """Return the listed files of a kind: place -> rows."""
    folder = Folder.open(str(address))
    places = [file.removeprefix(f"{folder.address}/") for file in list_files(str(address), kind)]
    return {place: folder.read_table(place).to_pandas() for place in places}


def read_bytes(address: Path | str, kind: str) -> dict[str, bytes]:
    """Return the listed files of a kind: place -> bytes."""
    folder = Folder.open(str(address))
    places = [file.removeprefix(f"{folder.address}/") for file in list_files(str(address), kind)]
    return dict(folder.fs.cat(places))
