"""palpate: examine produce by touch.

Settled values
    `predict_settled` predicts the settled value of holds with the methods `Relaxation`,
    `Exponential` or `Recorded` and returns `SettledEstimate`.
    `read_holds` returns each `Hold` of a file, and `plot_holds` draws holds. `read_recording` reads
    any table as `Readings`, and `cut_holds` finds its holds. `score` compares methods on holds and
    returns a `ScoreTable`.
Force
    `fit_force` fits a sensor to readings with known loads, from files or arrays, and returns a
    `FittedForce` that converts its other readings to newtons. `ForceLaw` is its law: readings of a
    sheet to newtons with an interval, after any number of measured forces.
Grasps
    `open_rig` opens a `Rig`. `Rig.read` returns a `Reading`; `Rig.grasp` returns a `Grip` that
    holds until its release. At a lower level, `plan_grasp` returns a `Plan`, and `run_grasp`
    returns a `GraspResult` with an `Outcome`. Each measured quantity is a `Measurement`.
Recordings
    `load_recording` reads a recording into arrays.
Shared
    `Status` is the status of an estimate. `PalpateError` is the base class of all exceptions, and
    `InputError` reports an invalid argument.

Names are imported on first use, so ``import palpate`` is fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from palpate.version import __version__ as __version__

if TYPE_CHECKING:
    from palpate.calibrate.recorded_force import FittedForce, fit_force
    from palpate.errors import InputError, PalpateError
    from palpate.force.force_law import ForceLaw
    from palpate.grasp.plan import Plan
    from palpate.grasp.planning import plan_grasp
    from palpate.grasp.result import GraspResult, Outcome
    from palpate.grasp.runner import run_grasp
    from palpate.holds import Hold, read_holds
    from palpate.holds.cutting import cut_holds
    from palpate.holds.recordings import Readings, read_recording
    from palpate.measurement import Measurement, Status
    from palpate.plots.holds import plot_holds
    from palpate.recording import load_recording
    from palpate.rig import Rig, open_rig
    from palpate.rig.grip import Grip
    from palpate.rig.guard import ForceGuard
    from palpate.rig.reading import Reading
    from palpate.scoring.table import ScoreTable, score
    from palpate.settling.baselines import Recorded
    from palpate.settling.exponential import Exponential
    from palpate.settling.predict import predict_settled
    from palpate.settling.relaxation import Relaxation
    from palpate.settling.result import SettledEstimate

__all__ = [
    "Exponential",
    "FittedForce",
    "ForceGuard",
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
    "fit_force",
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

_MODULES = {
    "Exponential": "palpate.settling.exponential",
    "FittedForce": "palpate.calibrate.recorded_force",
    "ForceGuard": "palpate.rig.guard",
    "ForceLaw": "palpate.force.force_law",
    "GraspResult": "palpate.grasp.result",
    "Grip": "palpate.rig.grip",
    "Hold": "palpate.holds",
    "InputError": "palpate.errors",
    "Measurement": "palpate.measurement",
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
    "Status": "palpate.measurement",
    "cut_holds": "palpate.holds.cutting",
    "fit_force": "palpate.calibrate.recorded_force",
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
    if name not in _MODULES:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    found = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
