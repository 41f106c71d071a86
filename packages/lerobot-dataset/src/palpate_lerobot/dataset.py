"""Write the files of a LeRobot v3.0 data set: frames, episodes, tasks, statistics, info.

The layout is that of LeRobot 0.4's writer; `packages/lerobot/check_with_lerobot.py` reads the files
with its loader.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.files import atomic_folder
from palpate_lerobot.episode import GraspTrack
from palpate_lerobot.statistics import statistics

_FORMAT = "v3.0"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
#: Integer columns of every LeRobot data set.
_INDEX_COLUMNS = ("frame_index", "episode_index", "index", "task_index")


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """A grasp on the time grid of its data set."""

    grasp: GraspTrack
    task: str
    #: Column of the data set -> values, one row per tick.
    columns: dict[str, NDArray[Any]]


def write_dataset(
    folder: Path, grasps: Sequence[tuple[GraspTrack, str]], *, fps: int, version: str
) -> list[Episode]:
    """Write a data set atomically; return its episodes.

    Parameters
    ----------
    folder : Path
        A new folder.
    grasps : sequence of (GraspTrack, str)
        At least one grasp, all of one kind of sensor and gripper, with their tasks in words.
    fps : int
        Ticks per second.
    version : str
        Version of palpate, which recomputed the commands.

    Raises
    ------
    InputError
        If the folder exists, or the grasps differ in sensor or gripper.
    RecordingError
        If a recording has too few frames for the time grid.
    """
    _check_same_kind([grasp for grasp, _ in grasps])
    episodes = _build_episodes(grasps, fps=fps)
    with atomic_folder(folder) as partial:
        _write_frames(partial, episodes)
        _write_tasks(partial, _list_tasks(grasps))
        _write_episodes(partial, episodes)
        every = {name: _join(episodes, name) for name in episodes[0].columns}
        stats = {name: statistics(values) for name, values in every.items()}
        _write_json(partial / "meta/stats.json", stats)
        _write_json(partial / "meta/info.json", _describe(episodes, fps=fps, version=version))
        (partial / "README.md").write_text(_write_card_text(episodes), encoding="utf-8")
    return episodes


def _check_same_kind(grasps: Sequence[GraspTrack]) -> None:
    first = grasps[0]
    for other in grasps[1:]:
        if other.state_names != first.state_names:
            raise InputError(
                f"{other.path}: its sensor or gripper differs from that of {first.path} "
                f"({', '.join(other.state_names)}); a data set must have one kind"
            )


def _list_tasks(grasps: Sequence[tuple[GraspTrack, str]]) -> list[str]:
    return list(dict.fromkeys(task for _, task in grasps))


def _build_episodes(grasps: Sequence[tuple[GraspTrack, str]], *, fps: int) -> list[Episode]:
    tasks, episodes, begin = _list_tasks(grasps), list[Episode](), 0
    for number, (grasp, task) in enumerate(grasps):
        ticks = grasp.at_rate(fps)
        index = np.arange(len(ticks))
        columns: dict[str, NDArray[Any]] = {
            "observation.state": grasp.state[ticks].astype(np.float32),
            "action": grasp.action[ticks].astype(np.float32),
            "timestamp": (index / fps).astype(np.float32),
            "frame_index": index,
            "episode_index": np.full(len(ticks), number),
            "index": begin + index,
            "task_index": np.full(len(ticks), tasks.index(task)),
        }
        episodes.append(Episode(grasp=grasp, task=task, columns=columns))
        begin += len(ticks)
    return episodes


def _join(episodes: Sequence[Episode], name: str) -> NDArray[Any]:
    return np.concatenate([episode.columns[name] for episode in episodes])


def _write_frames(folder: Path, episodes: Sequence[Episode]) -> None:
    import pyarrow

    columns = {}
    for name in episodes[0].columns:
        values = _join(episodes, name)
        flat = pyarrow.array(values.ravel())
        columns[name] = (
            flat
            if values.ndim == 1
            else pyarrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
        )
    _write_parquet(folder / "data", pyarrow.table(columns))


def _write_tasks(folder: Path, tasks: list[str]) -> None:
    """Write the tasks as the index of a pandas frame, where LeRobot expects them."""
    import pyarrow
    import pyarrow.parquet

    index = "__index_level_0__"
    table = pyarrow.table({"task_index": pyarrow.array(range(len(tasks))), index: tasks})
    kinds = {"task_index": ("int64", "int64"), index: ("unicode", "object")}
    described = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [
            {
                "name": None if name == index else name,
                "field_name": name,
                "pandas_type": kind,
                "numpy_type": numpy_kind,
                "metadata": None,
            }
            for name, (kind, numpy_kind) in kinds.items()
        ],
        "creator": {"library": "palpate", "version": ""},
        "pandas_version": "2.2.0",
    }
    path = folder / "meta" / "tasks.parquet"
    path.parent.mkdir(exist_ok=True)
    pyarrow.parquet.write_table(
        table.replace_schema_metadata({"pandas": json.dumps(described)}), path
    )


def _write_episodes(folder: Path, episodes: Sequence[Episode]) -> None:
    import pyarrow

    rows = []
    for episode in episodes:
        index, info = episode.columns["index"], episode.grasp.info
        rows.append(
            {
                "episode_index": int(episode.columns["episode_index"][0]),
                "tasks": [episode.task],
                "length": len(index),
                "data/chunk_index": 0,
                "data/file_index": 0,
                "dataset_from_index": int(index[0]),
                "dataset_to_index": int(index[-1]) + 1,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{
                    f"stats/{name}/{statistic}": found
                    for name, values in episode.columns.items()
                    for statistic, found in statistics(values).items()
                },
                "palpate/recording": episode.grasp.path.name,
                "palpate/origin": info.origin,
                "palpate/simulated": info.origin != "hardware",
                "palpate/rig": info.rig,
                "palpate/seed": info.seed,
                "palpate/kind": info.kind,
                "palpate/outcome": episode.grasp.outcome,
                "palpate/recorded_by": info.versions.get("palpate"),
            }
        )
    _write_parquet(folder / "meta" / "episodes", pyarrow.Table.from_pylist(rows))


def _write_parquet(folder: Path, table: Any) -> None:
    import pyarrow.parquet

    path = folder / _FILE.format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True)
    pyarrow.parquet.write_table(table, path)


def _describe(episodes: Sequence[Episode], *, fps: int, version: str) -> dict[str, Any]:
    grasp = episodes[0].grasp
    vectors = {"observation.state": grasp.state_names, "action": grasp.action_names}
    origins = sorted({episode.grasp.info.origin for episode in episodes})
    return {
        "codebase_version": _FORMAT,
        "robot_type": f"palpate gripper{_describe_origin(episodes)}",
        "total_episodes": len(episodes),
        "total_frames": sum(len(episode.columns["index"]) for episode in episodes),
        "total_tasks": len({episode.task for episode in episodes}),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": {
            **{
                name: {"dtype": "float32", "shape": [len(names)], "names": names}
                for name, names in vectors.items()
            },
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            **{name: {"dtype": "int64", "shape": [1], "names": None} for name in _INDEX_COLUMNS},
        },
        "palpate": {
            "version": version,
            "origins": origins,
            "simulated": origins != ["hardware"],
            "action": "recomputed from the recorded frames",
        },
    }


def _describe_origin(episodes: Sequence[Episode]) -> str:
    count = sum(episode.grasp.info.origin != "hardware" for episode in episodes)
    if count in (0, len(episodes)):
        return " (SIMULATED)" if count else ""
    return f" ({count} of {len(episodes)} episodes SIMULATED)"


def _write_card_text(episodes: Sequence[Episode]) -> str:
    """Return the data set card for a hub."""
    config = "configs:\n- config_name: default\n  data_files: data/*/*.parquet\n"
    return (
        f"---\ntags:\n- LeRobot\n{config}---\n\n"
        f"{len(episodes)} grasps with palpate{_describe_origin(episodes)}. `observation.state` is "
        "the measurement, `action` the commanded opening and speed; the names and units of the "
        "columns are in `meta/info.json`. Force is an estimate with its 90 % interval. The origin "
        "of each episode is in its `palpate/...` columns.\n"
    )


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")
