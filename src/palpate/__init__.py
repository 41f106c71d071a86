"""palpate: examine produce by touch.

Settled values
    `predict_settled` predicts where holds settle to, `SettlingStream` does so sample by sample;
    methods are `Relaxation`, `Exponential` and `Recorded`, answers a `SettledEstimate`.
    `read_holds` yields each `Hold` of a file; `read_recording` and `cut_holds` find them in any
    table, as `Readings`.
Grasps
    `open_rig` opens a `Rig`, `plan_grasp` makes a `Plan`, `run_grasp` returns a `GraspResult` with
    an `Outcome`; each quantity measured is a `Measurement`.
Recordings
    `load_recording`.
Shared
    `Status` is how an estimate came about; `PalpateError` is the root of what is raised.

Names are loaded on first use, so that ``import palpate`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.errors import PalpateError
    from palpate.estimate.measurement import Measurement
    from palpate.grasp.plan import Plan
    from palpate.grasp.planning import plan_grasp
    from palpate.grasp.result import GraspResult, Outcome
    from palpate.grasp.runner import run_grasp
    from palpate.holds import Hold, read_holds
    from palpate.readings import Readings, cut_holds, read_recording
    from palpate.recording import load_recording
    from palpate.rig import Rig, open_rig
    from palpate.settling.exponential import Exponential
    from palpate.settling.predict import predict_settled
    from palpate.settling.recorded import Recorded
    from palpate.settling.relaxation import Relaxation
    from palpate.settling.result import SettledEstimate, Status
    from palpate.settling.streaming import SettlingStream

__version__ = "0.1.0"

__all__ = [
    "Exponential",
    "GraspResult",
    "Hold",
    "Measurement",
    "Outcome",
    "PalpateError",
    "Plan",
    "Readings",
    "Recorded",
    "Relaxation",
    "Rig",
    "SettledEstimate",
    "SettlingStream",
    "Status",
    "cut_holds",
    "load_recording",
    "open_rig",
    "plan_grasp",
    "predict_settled",
    "read_holds",
    "read_recording",
    "run_grasp",
]

_HOMES = {
    "Exponential": "palpate.settling.exponential",
    "GraspResult": "palpate.grasp.result",
    "Hold": "palpate.holds",
    "Measurement": "palpate.estimate.measurement",
    "Outcome": "palpate.grasp.result",
    "PalpateError": "palpate.errors",
    "Plan": "palpate.grasp.plan",
    "Readings": "palpate.readings",
    "Recorded": "palpate.settling.recorded",
    "Relaxation": "palpate.settling.relaxation",
    "Rig": "palpate.rig",
    "SettledEstimate": "palpate.settling.result",
    "SettlingStream": "palpate.settling.streaming",
    "Status": "palpate.settling.result",
    "cut_holds": "palpate.readings",
    "load_recording": "palpate.recording",
    "open_rig": "palpate.rig",
    "plan_grasp": "palpate.grasp.planning",
    "predict_settled": "palpate.settling.predict",
    "read_holds": "palpate.holds",
    "read_recording": "palpate.readings",
    "run_grasp": "palpate.grasp.runner",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
