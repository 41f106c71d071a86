"""How many pixels a finger needs, and what dead ones do to the force."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.sensor.array import ArrayLayout
from palpate.signal.relative import excess_conductance
from palpate_studies.equal_width import SEED
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import LEVELS, Session, drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pixels along and across one finger; all cover the same pad.
GRIDS = {"1x1": (1, 1), "2x2 (paper)": (2, 2), "3x3": (3, 3), "4x4": (4, 4)}
PAD_MM, SENSORS = 20.0, 5
CALIBRATED_ON, TESTED_ON = "dragonskin-20", {"flat": "springs-8", "round": "ball-44lbs"}
CALIBRATED_MM, TESTED_MM = tuple(np.geomspace(0.6, 4.0, 10)), (1.2, 1.8, 2.5, 3.2)
DEAD = (0, 1, 2, 4)
#: What is done about dead pixels.
REMEDIES = ("left out of the sum", "sum scaled to all pixels", "calibrated without them")

#: Median |error|, %, by level, grid and face; errors by level, face and number of dead pixels.
Counted: TypeAlias = dict[tuple[str, str, str], float]
Broken: TypeAlias = dict[tuple[str, str, int], FloatArray]


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Compare numbers of pixels, and remedies for dead ones, on simulated sensors.

    Example: palpate study pixels --out reports
    """
    report().emit(as_json=as_json, out=out)


def layout_of(grid: tuple[int, int]) -> ArrayLayout:
    """Return two fingers with `grid` pixels along and across, on one size of pad."""
    along, across = grid
    return ArrayLayout(
        name=f"{along}x{across}",
        rows=2 * along,
        cols=across,
        finger_of_row=(0,) * along + (1,) * along,
        pitch_mm=PAD_MM / along,
    )


def report(*, sensors: int = SENSORS) -> StudyReport:
    """Measure the error of force for each number of pixels, and of dead ones."""
    counted = {
        (level, grid, face): _median(
            [_error(*_pairs(sensor, level, grid, face)) for sensor in range(sensors)]
        )
        for level in LEVELS
        for grid in GRIDS
        for face in TESTED_ON
    }
    broken = {
        (level, face, dead): np.array(
            [
                dead_errors(*_pairs(s, level, "2x2 (paper)", face), dead=dead, seed=s)
                for s in range(sensors)
            ]
        )
        for level in LEVELS
        for face in TESTED_ON
        for dead in DEAD
    }
    return StudyReport(
        name="pixels",
        title="Number of pixels, and dead ones",
        provenance=[
            f"Simulated: {sensors} sensors per level; a power law in summed excess calibrated on "
            f"{CALIBRATED_ON} (flat), tested on springs (flat) and a ball laid anywhere (round).",
            f"All grids cover a pad of {PAD_MM:g} mm; smaller pixels answer to pressure alike. "
            "Dead pixels read open and are drawn at random. The paper has no such data.",
            "A pixel of the twin answers to its whole force, however that lies within it, so one "
            "large pixel is too kind to round things. Small pixels bend more under a round thing: "
            "their sum reads too much force, and only a calibration on round things helps.",
        ],
        tables=[_by_count(counted), _by_dead(broken)],
        payload=_payload(counted, broken),
        figures={"pixels": lambda: draw(counted, broken)},
    )


def _by_count(counted: Counted) -> Table:
    return Table(
        title="Median |error| of force, percent, by pixels per finger",
        columns=("grid", "tested on", *LEVELS),
        rows=[
            [grid, face, *(f"{counted[level, grid, face]:.1f}" for level in LEVELS)]
            for grid in GRIDS
            for face in TESTED_ON
        ],
    )


def _by_dead(broken: Broken) -> Table:
    ways = [(level, index) for level in LEVELS for index in range(len(REMEDIES))]
    return Table(
        title="Median |error| of force, percent, with dead pixels of eight",
        columns=("dead", "tested on", *(f"{REMEDIES[index]}, {level}" for level, index in ways)),
        rows=[
            [
                str(dead),
                face,
                *(f"{_median(broken[level, face, dead][:, index]):.1f}" for level, index in ways),
            ]
            for dead in DEAD
            for face in TESTED_ON
        ],
    )


def _payload(counted: Counted, broken: Broken) -> dict[str, Any]:
    return {
        "study": "pixels",
        "origin": "twin",
        "by_count": [
            {"level": level, "grid": grid, "tested_on": face, "median_abs_error_percent": value}
            for (level, grid, face), value in counted.items()
        ],
        "dead": [
            {
                "level": level,
                "tested_on": face,
                "dead": dead,
                "median_abs_error_percent": {
                    remedy: _median(values[:, index]) for index, remedy in enumerate(REMEDIES)
                },
            }
            for (level, face, dead), values in broken.items()
        ],
    }


@lru_cache(maxsize=512)
def _made(sensor: int, level: str, grid: str, name: str) -> tuple[FloatArray, FloatArray]:
    """Return forces and excess conductances, shapes (grasps,) and (grasps, pixels)."""
    closures = CALIBRATED_MM if name == CALIBRATED_ON else TESTED_MM
    session = Session(sensor, level=level, trial=len(name), layout=layout_of(GRIDS[grid]))
    obj = drawn(name, seed=SEED)
    forces, excesses = [], []
    for closure_mm in closures:
        session.place(obj)
        reading = session.grasp(obj.size_mm, width_mm=obj.size_mm - closure_mm)
        forces.append(reading.force_n)
        excesses.append(excess_conductance(reading.ohm, rest_ohm=reading.rest_ohm).ravel())
    return np.array(forces), np.array(excesses)


def _pairs(
    sensor: int, level: str, grid: str, face: str
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return what is calibrated on and what is tested on."""
    return (
        _made(sensor, level, grid, CALIBRATED_ON),
        _made(sensor, level, grid, TESTED_ON[face]),
    )


def _error(
    calibrated: tuple[FloatArray, FloatArray],
    tested: tuple[FloatArray, FloatArray],
    *,
    scale: float = 1.0,
) -> float:
    """Return the median |error| of force in percent."""
    try:
        law = PowerForceLaw.fit(np.nansum(calibrated[1], axis=1), force_n=calibrated[0])
    except CalibrationError:
        return float("inf")
    predicted = law.force_n(scale * np.nansum(tested[1], axis=1)).value
    return float(100 * np.median(np.abs(predicted / tested[0] - 1)))


def dead_errors(
    calibrated: tuple[FloatArray, FloatArray],
    tested: tuple[FloatArray, FloatArray],
    *,
    dead: int,
    seed: int,
) -> list[float]:
    """Return the error under each remedy when `dead` pixels read open."""
    pixels = calibrated[1].shape[1]
    gone = np.random.default_rng([seed, dead]).permutation(pixels)[:dead]
    alive = np.setdiff1d(np.arange(pixels), gone)
    left = (tested[0], tested[1][:, alive])
    return [
        _error(calibrated, left),
        _error(calibrated, left, scale=pixels / alive.size),
        _error((calibrated[0], calibrated[1][:, alive]), left),
    ]


def _median(values: object) -> float:
    return float(np.median(np.asarray(values)))


def draw(counted: Counted, broken: Broken) -> Figure:
    """Draw error against pixels per finger, and against dead pixels."""
    from palpate.plots.style import BLUE, GREEN, ORANGE, new_figure

    with new_figure(rows=2, columns=2, width_in=9.0, height_in=6.2) as (figure, axes):
        for row, level in zip(axes, LEVELS, strict=True):
            for face, line in zip(TESTED_ON, ("o-", "s--"), strict=True):
                values = [counted[level, grid, face] for grid in GRIDS]
                row[0].plot(list(GRIDS), values, line, color=BLUE, label=face)
                for index, colour in enumerate((ORANGE, GREEN, BLUE)):
                    dead = [_median(broken[level, face, count][:, index]) for count in DEAD]
                    row[1].plot(DEAD, dead, line, color=colour, label=f"{face}, {REMEDIES[index]}")
            row[0].set(xlabel="pixels per finger", title=f"simulated, {level}", ylim=(0, None))
            row[1].set(xlabel="dead pixels of eight", ylim=(0, None), xticks=DEAD)
            for axis in row:
                axis.set_ylabel("median |error| of force (%)")
        axes[0, 0].legend()
        axes[0, 1].legend(fontsize=7)
    return figure
