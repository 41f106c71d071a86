"""Whether LeRobot itself reads what `palpate export --lerobot` writes.

Run `python bridges/lerobot/check_with_lerobot.py DIR` in an environment with LeRobot 0.4 or 0.6;
palpate need not be in it. Its loader opens the data set, its own statistics of each episode are
compared with ours, and a loader of torch goes through it in batches with a window of the past. Ends
with status 1 where something is not as it should be.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

# What is not on this disk is not looked for elsewhere.
os.environ["HF_HUB_OFFLINE"] = "1"

#: LeRobot's quantiles are of a histogram, ours exact: their ranks are compared, as shares of 1.
_RANKS_APART = 0.02
#: LeRobot's deviations are of sums of squares in single precision; ours are exact to this share.
_STD_APART = 2e-3


def check(holds: bool, what: str) -> None:
    print(("ok  " if holds else "BAD ") + what)
    if not holds:
        sys.exit(1)


def ranks_apart(values: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Return how far apart two quantiles are in rank, at the worst of the columns."""
    near = 1e-3 * (np.max(values, axis=0) - np.min(values, axis=0)) + 1e-6
    below = [np.mean(values < quantile - near, axis=0) for quantile in (one, other)]
    up_to = [np.mean(values <= quantile + near, axis=0) for quantile in (one, other)]
    return float(np.max(np.maximum(below[0] - up_to[1], below[1] - up_to[0])))


def check_statistics(meta: Any, rows: dict[str, np.ndarray], kept: dict[str, Any]) -> None:
    """Compare the statistics of each episode with those that LeRobot works out."""
    from lerobot.datasets.compute_stats import compute_episode_stats

    for number, episode in enumerate(meta.episodes):
        part = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        values = {name: column[part] for name, column in rows.items()}
        for name, theirs in compute_episode_stats(values, meta.features).items():
            for statistic, wanted in theirs.items():
                ours = np.array(kept[f"stats/{name}/{statistic}"][number])
                same = ours.shape == np.shape(wanted)
                if statistic.startswith("q"):
                    same = same and ranks_apart(values[name], ours, wanted) <= _RANKS_APART
                else:
                    apart = _STD_APART if statistic == "std" else 1e-4
                    same = same and np.allclose(ours, wanted, rtol=apart, atol=1e-4)
                if not same:
                    check(False, f"{statistic} of {name} in episode {number}: {ours}, {wanted}")
    check(True, f"statistics of {len(meta.episodes)} episodes are those that LeRobot works out")


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
    check(len(data) == meta.total_frames, "every frame is there")
    info = json.loads((folder / "meta/info.json").read_text())
    check(info["palpate"]["simulated"] is True, "the origin is in the metadata: simulated")
    width = len(meta.names["observation.state"])
    first = data[0]
    check(tuple(first["observation.state"].shape) == (width,), "a state has all its names")
    check(tuple(first["action"].shape) == (2,), "an action is a position and a rate")
    check(first["task"] == meta.tasks.index[0], f"a frame has its task: {first['task']}")
    rows = {
        name: np.stack([np.asarray(value) for value in data.hf_dataset[name][:]])
        for name in meta.features
    }
    ticks = rows["frame_index"] / meta.fps
    check(np.allclose(rows["timestamp"], ticks, atol=1e-5), "time is the tick's number / fps")
    check(np.array_equal(rows["index"], np.arange(len(data))), "frames are numbered throughout")
    files = str(folder / "meta/episodes/*/*.parquet")
    kept = load_dataset("parquet", data_files=files, split="train").to_dict()
    check_statistics(meta, rows, kept)
    past = {"observation.state": [-2 / meta.fps, -1 / meta.fps, 0.0]}
    windows = LeRobotDataset("palpate/check", root=folder, delta_timestamps=past)
    batches = torch.utils.data.DataLoader(windows, batch_size=32, shuffle=True)
    shapes = {tuple(batch["observation.state"].shape[1:]) for batch in batches}
    check(shapes == {(3, width)}, "torch goes through it in batches, with two ticks of the past")
    last = LeRobotDataset("palpate/check", root=folder, episodes=[meta.total_episodes - 1])
    wanted = meta.episodes[-1]["length"]
    check(len(last) == wanted, "one episode can be loaded alone")


if __name__ == "__main__":
    main()
