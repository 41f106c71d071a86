"""`palpate export --lerobot DIR`: export recorded grasps as a data set."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from palpate import __version__
from palpate.errors import InputError
from palpate_lerobot.dataset import Episode, write_dataset
from palpate_lerobot.episode import GraspTrack, read_grasp


def export_lerobot(files: list[Path], *, folder: Path, task: str | None, fps: int | None) -> None:
    """Read grasps, write them as a data set, and print a summary.

    Raises `InputError` if the folder exists, or the grasps differ in sensor or gripper;
    `RecordingError` if a file is not of a grasp or has too few frames.
    """
    if folder.exists():
        raise InputError(f"--lerobot {folder}: already exists; choose a new folder")
    grasps = [read_grasp(file) for file in files]
    fps = round(grasps[0].rate_hz) if fps is None else fps
    episodes = [(grasp, task or _task(grasp)) for grasp in grasps]
    _report(folder, write_dataset(folder, episodes, fps=fps, version=__version__), fps=fps)


def _task(grasp: GraspTrack) -> str:
    what, target_n = grasp.info.kind or "object", grasp.info.target_force_n
    if target_n is None:
        return f"Grasp the {what} gently and examine it by touch."
    return f"Grasp the {what} with {target_n:g} N."


def _report(folder: Path, episodes: list[Episode], *, fps: int) -> None:
    frames = sum(len(episode.columns["index"]) for episode in episodes)
    simulated = sum(episode.grasp.info.origin != "hardware" for episode in episodes)
    origin = f", {simulated} of them SIMULATED" if simulated else ""
    print(
        f"{folder}: {len(episodes)} episodes{origin}, {frames} frames at {fps} a second",
        file=sys.stderr,
    )
    unread = sum(int(np.isnan(one.columns["observation.state"]).sum()) for one in episodes)
    if unread:
        print(f"{unread} values are NaN: pixels without a reading", file=sys.stderr)
    others = sum(one.grasp.info.versions.get("palpate") != __version__ for one in episodes)
    if others:
        print(
            f"{others} recordings are of another version of palpate; their commands are "
            "recomputed by this version",
            file=sys.stderr,
        )
