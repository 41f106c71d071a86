"""Check that LeRobot reads the data sets of `palpate export --lerobot`.

Run `python packages/lerobot/check_with_lerobot.py DIR` in an environment with LeRobot 0.4 or 0.6;
palpate is not required. The data set is opened with LeRobot's loader, the statistics of each
episode are compared with LeRobot's, and a torch loader reads batches with a window of past ticks.
The exit status is 1 if a check fails.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

# Only local files are read.
os.environ["HF_HUB_OFFLINE"] = "1"

#: LeRobot computes quantiles from a histogram, so their ranks (0 to 1) are compared.
_RANK_TOLERANCE = 0.02
#: LeRobot computes deviations from sums of squares in single precision (relative tolerance).
_STD_TOLERANCE = 2e-3


def check(passed: bool, what: str) -> None:
    print(("ok  " if passed else "BAD ") + what)
    if not passed:
        sys.exit(1)


def rank_difference(values: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference in rank between two quantiles over the columns."""
    near = 1e-3 * (np.max(values, axis=0) - np.min(values, axis=0)) + 1e-6
    below = [np.mean(values < quantile - near, axis=0) for quantile in (one, other)]
    up_to = [np.mean(values <= quantile + near, axis=0) for quantile in (one, other)]
    return float(np.max(np.maximum(below[0] - up_to[1], below[1] - up_to[0])))


def check_statistics(meta: Any, rows: dict[str, np.ndarray], kept: dict[str, Any]) -> None:
    """Compare the statistics of each episode with LeRobot's."""
    from lerobot.datasets.compute_stats import compute_episode_stats

    for number, episode in enumerate(meta.episodes):
        part = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        values = {name: column[part] for name, column in rows.items()}
        for name, theirs in compute_episode_stats(values, meta.features).items():
            for statistic, wanted in theirs.items():
                ours = np.array(kept[f"stats/{name}/{statistic}"][number])
                same = ours.shape == np.shape(wanted)
                if statistic.startswith("q"):
                    same = same and rank_difference(values[name], ours, wanted) <= _RANK_TOLERANCE
                else:
                    tolerance = _STD_TOLERANCE if statistic == "std" else 1e-4
                    same = same and np.allclose(ours, wanted, rtol=tolerance, atol=1e-4)
                if not same:
                    check(False, f"{statistic} of {name} in episode {number}: {ours}, {wanted}")
    check(True, f"statistics of {len(meta.episodes)} episodes equal LeRobot's")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder.resolve()
    import torch
    from datasets import load_dataset
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    data = LeRobotDataset("palpate/check", root=folder)
    meta = data.meta
    print(f"{meta.robot_type}: {meta.total_episodes} episodes, {meta.total_frames} frames")
    check(len(data) == meta.total_frames, "all frames exist")
    info = json.loads((folder / "meta/info.json").read_text())
    check(info["palpate"]["simulated"] is True, "the metadata state the simulated origin")
    width = len(meta.names["observation.state"])
    first = data[0]
    check(tuple(first["observation.state"].shape) == (width,), "a state has one value per name")
    check(tuple(first["action"].shape) == (2,), "an action has a position and a rate")
    check(first["task"] == meta.tasks.index[0], f"a frame has its task: {first['task']}")
    rows = {
        name: np.stack([np.asarray(value) for value in data.hf_dataset[name][:]])
        for name in meta.features
    }
    ticks = rows["frame_index"] / meta.fps
    check(np.allclose(rows["timestamp"], ticks, atol=1e-5), "timestamps are frame index / fps")
    check(np.array_equal(rows["index"], np.arange(len(data))), "indices are consecutive")
    files = str(folder / "meta/episodes/*/*.parquet")
    kept = load_dataset("parquet", data_files=files, split="train").to_dict()
    check_statistics(meta, rows, kept)
    past = {"observation.state": [-2 / meta.fps, -1 / meta.fps, 0.0]}
    windows = LeRobotDataset("palpate/check", root=folder, delta_timestamps=past)
    batches = torch.utils.data.DataLoader(windows, batch_size=32, shuffle=True)
    shapes = {tuple(batch["observation.state"].shape[1:]) for batch in batches}
    check(shapes == {(3, width)}, "torch reads batches with two past ticks")
    last = LeRobotDataset("palpate/check", root=folder, episodes=[meta.total_episodes - 1])
    wanted = meta.episodes[-1]["length"]
    check(len(last) == wanted, "one episode can be loaded alone")


if __name__ == "__main__":
    main()
