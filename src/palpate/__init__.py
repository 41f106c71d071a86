"""palpate: examine produce by touch.

Settled values
    `predict_settled` predicts where holds settle to; methods are `Relaxation`, `Exponential` and
    `Recorded`, answers a `SettledEstimate`.
    `read_holds` returns each `Hold` of a file, `plot_holds` draws them; `read_recording` and
    `cut_holds` find them in any table, as `Readings`. `score` compares methods on holds, in a
    `ScoreTable`.
Force
    `ForceLaw` turns readings of a sheet into newtons with an interval, from any number of forces
    measured on it.
Grasps
    `open_rig` opens a `Rig`; its `read` returns a `Reading`, its `grasp` a `Grip` that holds until
    it is released. Below them, `plan_grasp` makes a `Plan`, and `run_grasp` returns a `GraspResult`
    with an `Outcome`; each quantity measured is a `Measurement`.
Recordings
    `load_recording`.
Shared
    `Status` is how an estimate came about; `PalpateError` is the root of what is raised, and
    `InputError` means that an argument can't be used.

Names are loaded on first use, so that ``import palpate`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from palpate.version import __version__ as __version__

if TYPE_CHECKING:
    from palpate.errors import InputError, PalpateError
    from palpate.estimate.force_law import ForceLaw
    from palpate.estimate.measurement import Measurement
    from palpate.grasp.plan import Plan
    from palpate.grasp.planning import plan_grasp
    from palpate.grasp.result import GraspResult, Outcome
    from palpate.grasp.runner import run_grasp
    from palpate.holds import Hold, read_holds
    from palpate.holds.cutting import cut_holds
    from palpate.holds.recordings import Readings, read_recording
    from palpate.plots.holds import plot_holds
    from palpate.recording import load_recording
    from palpate.rig import Rig, open_rig
    from palpate.rig.grip import Grip
    from palpate.rig.reading import Reading
    from palpate.scoring.table import ScoreTable, score
    from palpate.settling.baselines import Recorded
    from palpate.settling.exponential import Exponential
    from palpate.settling.predict import predict_settled
    from palpate.settling.relaxation import Relaxation
    from palpate.settling.result import SettledEstimate, Status

__all__ = [
    "Exponential",
    "ForceLaw",
    "GraspResult",
    "Grip",
    "Hold",
    "InputError",
    "Measurement",
    "Outcome",
    "PalpateError",
    "Plan",
    "Reading",
    "Readings",
    "Recorded",
    "Relaxation",
    "Rig",
    "ScoreTable",
    "SettledEstimate",
    "Status",
    "cut_holds",
    "load_recording",
    "open_rig",
    "plan_grasp",
    "plot_holds",
    "predict_settled",
    "read_holds",
    "read_recording",
    "run_grasp",
    "score",
]

_HOMES = {
    "Exponential": "palpate.settling.exponential",
    "ForceLaw": "palpate.estimate.force_law",
    "GraspResult": "palpate.grasp.result",
    "Grip": "palpate.rig.grip",
    "Hold": "palpate.holds",
    "InputError": "palpate.errors",
    "Measurement": "palpate.estimate.measurement",
    "Outcome": "palpate.grasp.result",
    "PalpateError": "palpate.errors",
    "Plan": "palpate.grasp.plan",
    "Reading": "palpate.rig.reading",
    "Readings": "palpate.holds.recordings",
    "Recorded": "palpate.settling.baselines",
    "Relaxation": "palpate.settling.relaxation",
    "Rig": "palpate.rig",
    "ScoreTable": "palpate.scoring.table",
    "SettledEstimate": "palpate.settling.result",
    "Status": "palpate.settling.result",
    "cut_holds": "palpate.holds.cutting",
    "load_recording": "palpate.recording",
    "open_rig": "palpate.rig",
    "plan_grasp": "palpate.grasp.planning",
    "plot_holds": "palpate.plots.holds",
    "predict_settled": "palpate.settling.predict",
    "read_holds": "palpate.holds",
    "read_recording": "palpate.holds.recordings",
    "run_grasp": "palpate.grasp.runner",
    "score": "palpate.scoring.table",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
