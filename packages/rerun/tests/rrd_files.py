"""Reads `.rrd` files with Rerun's own reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa


def read_rrd(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Return the columns of each entity by the names of their components.

    The columns ``sensor_time`` and ``wall_time`` are in nanoseconds.
    """
    # Here, because doctests are collected without the SDK too.
    from rerun.chunk import RrdReader

    entities: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = entities.setdefault(chunk.entity_path.removeprefix("/"), {})
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if pa.types.is_temporal(column.type):
                column = column.cast(pa.int64())
            columns.setdefault(name, []).extend(column.to_pylist())
    return entities


def series(entity: dict[str, list[Any]]) -> list[Any]:
    """Return the numbers of an entity of scalars, in the order of the sensor's time."""
    pairs = zip(entity["sensor_time"], entity["Scalars:scalars"], strict=True)
    return [values for _, values in sorted(pairs, key=lambda pair: pair[0])]
