"""Train a policy for gentle grasps on exported grasps on a CPU, and run it.

    python examples/learn_from_grasps.py [GRASPS [TRIALS]]

GRASPS fruits are grasped at 2 N and exported like `palpate export --lerobot`, and a small network
learns to imitate the commands. It then grasps TRIALS new fruits with other hands, once without a
limit and once through `PolicyHand` with a force limit of 4 N. Everything is simulated. Requires
scikit-learn and `packages/lerobot-dataset`.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from palpate.gripper.interface import GripperCommand
from palpate.rig import open_rig
from palpate.rig.job import GraspJob
from palpate_lerobot.export import export_lerobot
from palpate_lerobot.hand import PolicyHand

FRUITS = ("kiwi", "strawberry", "banana", "avocado-day-4", "tomato", "mango")
TARGET_N, LIMIT_N, HELD_N = 2.0, 4.0, 1.0
#: Lags of the policy's inputs, ticks (15 per second).
PAST = (0, 3, 8)
#: Decision period of the policy after contact, ticks, because the sheet lags during pressing.
PRESSING_TICKS = 8
TRIAL_TICKS, UNSEEN_SEED = 300, 1000


def record(folder: Path, *, grasps: int) -> Path:
    """Grasp, record and export; return the folder of the data set."""
    files = []
    for seed in range(grasps):
        rig = open_rig("sim-rigid", object_name=FRUITS[seed % len(FRUITS)], seed=seed)
        path = folder / f"{seed}.mcap"
        with GraspJob(rig, target_force_n=TARGET_N, record=path) as job:
            result = job.run()
        rig.close()
        if result.outcome == "held":
            files.append(path)
    export_lerobot(files, folder=folder / "grasps", task=None, fps=None)
    return folder / "grasps"


def build_inputs(states: Sequence[np.ndarray]) -> np.ndarray:
    """Return the policy's inputs: force and change per pixel, now and before, and speed."""
    ticks = [np.nan_to_num(states[max(len(states) - 1 - past, 0)]) for past in PAST]
    moved_mm = [ticks[0][0] - tick[0] for tick in ticks[1:]]
    return np.concatenate([*(tick[1:] for tick in ticks), moved_mm])


def train(dataset: Path) -> Any:
    """Imitate the commands before the release: travel (mm), and ln speed."""
    table = pq.read_table(dataset / "data").to_pydict()
    episodes = np.array(table["episode_index"])
    inputs, outputs = [], []
    for episode in np.unique(episodes):
        rows = np.flatnonzero(episodes == episode)
        states = np.array([table["observation.state"][row] for row in rows])
        actions = np.array([table["action"][row] for row in rows])
        # The release at the end is not part of the policy.
        end = 1 + int(np.flatnonzero(actions[:, 0] < actions[-1, 0]).max())
        for tick in range(end):
            inputs.append(build_inputs(states[: tick + 1]))
            travel_mm = actions[tick, 0] - states[tick, 0]
            outputs.append([travel_mm, np.log(max(actions[tick, 1], 0.5))])
    policy = make_pipeline(
        StandardScaler(),
        MLPRegressor(hidden_layer_sizes=(64, 64), alpha=1e-2, max_iter=300, random_state=1),
    )
    with warnings.catch_warnings():
        # With few grasps the training may not converge.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return policy.fit(np.array(inputs), np.array(outputs))


def grasp(policy: Any, *, seed: int, is_capped: bool) -> dict[str, Any]:
    """Run the policy on a fruit; return the truth."""
    rig = open_rig("sim-rigid", object_name=FRUITS[seed % len(FRUITS)], seed=seed)
    hand = PolicyHand(rig.array, rig.gripper, calibration=rig.calibration, limit_n=LIMIT_N)
    limits = rig.gripper.limits
    states: list[np.ndarray] = []
    for tick in range(TRIAL_TICKS):
        seen = hand.observe()
        states.append(np.array(list(seen.values())))
        if seen["force_n"] == 0.0 or tick % PRESSING_TICKS == 0:
            travel_mm, log_rate = policy.predict([build_inputs(states)])[0]
            target_mm = float(np.clip(seen["width_mm"] + travel_mm, limits.lowest, limits.highest))
            rate = float(np.clip(np.exp(log_rate), 0.5, 20.0))
        if is_capped:
            hand.send({"width_mm": target_mm, "rate_mm_per_s": rate})
        else:
            rig.gripper.command(GripperCommand(target=target_mm, rate=rate))
    assert rig.truth is not None
    truth = rig.truth()
    hand.close()
    return truth


def main(grasps: int, trials: int) -> None:
    """Learn, then grasp unseen fruits with and without the force cap."""
    with tempfile.TemporaryDirectory() as folder:
        policy = train(record(Path(folder), grasps=grasps))
    for is_capped, name in ((False, "no cap"), (True, f"cap {LIMIT_N:g} N")):
        truths = [
            grasp(policy, seed=UNSEEN_SEED + trial, is_capped=is_capped) for trial in range(trials)
        ]
        damaged = sum(truth["damaged"] for truth in truths)
        held = sum(not truth["damaged"] and truth["force_n"] >= HELD_N for truth in truths)
        peak_n = [truth["peak_force_n"] for truth in truths]
        print(
            f"{name}: {held} of {trials} held undamaged at {HELD_N:g} N or more, "
            f"{damaged} damaged; highest force, median {np.median(peak_n):.2f} N, "
            f"largest {max(peak_n):.2f} N (simulated)"
        )


if __name__ == "__main__":
    main(*(int(text) for text in (sys.argv[1:] + ["30", "16"][len(sys.argv) - 1 :])))
