"""Video 3: is anything there? Close, open, wait, and again until something is. Simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.grasp.belief import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.rig.simulated import calibrated
from palpate.sensor.calibration import Calibration
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate.twin.world import World
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.stoppable import uninterrupted

LEVELS = ("lab", "field")
FIRST_SEED = 300_000
#: Tries of one session, and how many of them find nothing before something is put there; drawn
#: from 0 to this, and one session in four never gets anything.
TRIES = 3
_NEVER = 4
#: Sessions that share a sensor and its calibration.
_PER_SHEET = 4
#: What may come: everything that the hand can close on.
_NAMES = tuple(name for name in OBJECTS if name != "rigid-block")


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """One session: when something came, and what was reported.

    Attributes
    ----------
    level, name : str
        Of the twin, and what came; empty for nothing.
    empty_tries : int
        Closings before it came.
    outcome : str
        How the session ended.
    said_empty : int
        Closings that were reported to find nothing.
    """

    level: str
    name: str
    empty_tries: int
    outcome: str
    said_empty: int

    @property
    def right(self) -> bool:
        """Whether every closing was called what it was."""
        found = "held" if self.name else "nothing_there"
        return self.outcome == found and self.said_empty == self.empty_tries


def command(
    sessions: Annotated[int, typer.Option(help="Sessions at each level.", min=1)] = 8,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Close, open, wait and close again until something is there, and count what was mistaken.

    Example: palpate study presence --sessions 40 --out reports
    """
    found = [
        watched(FIRST_SEED + index, level=level) for level in LEVELS for index in range(sessions)
    ]
    report(found).emit(as_json=as_json, out=out)


def watched(seed: int, *, level: str) -> Session:
    """Run one session."""
    rng, sheet = np.random.default_rng([seed, 36]), seed // _PER_SHEET
    never = seed % _PER_SHEET == _NEVER - 1
    empty = TRIES if never else int(rng.integers(TRIES))
    obj = None if never else draw_object(rng, str(rng.choice(_NAMES)))
    world = World(obj if empty == 0 else None, seed=seed, sheet_seed=sheet, level=level)
    gripper = TwinGripper(world)
    openings = [0, False]

    def bring(observation: Observation) -> None:
        """Count the openings, and put the object there at the right one."""
        wide = gripper.limits.closure(observation.gripper) < 1.0
        if wide and not openings[1]:
            openings[0] += 1
            if openings[0] == empty + 1 and empty and obj is not None:
                world.place(obj)
        openings[1] = wide

    plan = plan_grasp(_calibrated(sheet, level), gripper=gripper, tries=TRIES, longest_s=300.0)
    array = TwinArray(world)
    result = uninterrupted(
        run_grasp(plan, array=array, gripper=gripper, clock=world.clock, subscribers=[bring])
    )
    return Session(
        level=level,
        name="" if obj is None else obj.name,
        empty_tries=empty,
        outcome=str(result.outcome),
        said_empty=sum(moment.name == "nothing_there" for moment in result.moments),
    )


@lru_cache(maxsize=1)
def _calibrated(sheet: int, level: str) -> Calibration:
    return calibrated(seed=sheet, level=level, apart_from="")


def report(found: Sequence[Session]) -> StudyReport:
    """Return the report of any number of sessions."""
    summary = [_scores(level, [one for one in found if one.level == level]) for level in LEVELS]
    columns = {
        "sessions": "sessions",
        "closings": "closings",
        "on_nothing": "on nothing",
        "missed": "object missed",
        "imagined": "nothing taken for an object",
        "sessions_right": "sessions all right",
    }
    table = Table(
        title="Is anything there?",
        columns=("level", *columns.values()),
        rows=[[row["level"], *(str(row[key]) for key in columns)] for row in summary],
    )
    return StudyReport(
        name="presence",
        title="Presence: close, nothing there, open, wait, again (simulated)",
        provenance=(
            f"Simulated: up to {TRIES} closings of rigid fingers; an object of the paper or other "
            "produce comes before the first, second or third of them, in one session of four "
            "never. The paper's video 3 shows the task and gives no rates.",
        ),
        tables=[table],
        payload={
            "study": "presence",
            "simulated": True,
            "summary": summary,
            "rows": [
                {
                    "level": one.level,
                    "object": one.name or None,
                    "empty_tries": one.empty_tries,
                    "outcome": one.outcome,
                    "said_empty": one.said_empty,
                    "right": one.right,
                }
                for one in found
            ],
        },
    )


def _scores(level: str, found: Sequence[Session]) -> dict[str, Any]:
    closings = [min(one.empty_tries + (one.name != ""), TRIES) for one in found]
    return {
        "level": level,
        "sessions": len(found),
        "closings": sum(closings),
        "on_nothing": sum(one.empty_tries for one in found),
        "missed": sum(max(one.said_empty - one.empty_tries, 0) for one in found),
        "imagined": sum(
            one.outcome != "nothing_there" and one.said_empty < one.empty_tries for one in found
        ),
        "sessions_right": sum(one.right for one in found),
    }
