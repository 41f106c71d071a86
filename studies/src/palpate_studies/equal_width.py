"""Objects grasped at one width, as in section 3.2 of the paper: settled change of each, per sensor.

The paper prints no widths. Ours close by the middle of Table 1's five closures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.objects import TwinObject
from palpate_studies.report import StudyReport, Table
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import Reading, Session, grasps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SENSORS = 3
SEED = 1
CLOSURE_MM = 3.0
#: The data that set the spread of the level `lab`; to be stated wherever these tables are shown.
CALIBRATION_INPUT = (
    "The level `lab` got its scatter from grasp to grasp so as to be of the size of the "
    "published standard deviations, and its sheets so as to reach such changes; the twin's objects "
    "are guesses in the ratio of their makers' ratings. So agreement of single entries shows "
    "little; order, linearity and what is lost at `field` are predictions."
)
#: Reading -> what it is of a grasp. The first two are the paper's.
READINGS: dict[str, Callable[[Reading], float]] = {
    "mean change": lambda reading: reading.mean_percent,
    "largest change": lambda reading: reading.largest_percent,
    "summed excess": lambda reading: reading.excess,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """Settled readings of several objects on several sensors of one level.

    Attributes
    ----------
    names : tuple of str
        The objects.
    values : mapping of str to ndarray, shape (objects, sensors, repeats)
        Name in `READINGS` -> settled values, percent (the excess: a ratio).
    """

    names: tuple[str, ...]
    values: Mapping[str, FloatArray]

    def cell(self, reading: str, index: int) -> str:
        """Return the median sensor's mean and sd of one object, and the means' range."""
        values = self.values[reading][index]
        return mean_and_range(values.mean(axis=1), values.std(axis=1, ddof=1))

    def means(self, reading: str) -> FloatArray:
        """Return means over repeats, shape (objects, sensors)."""
        return np.asarray(self.values[reading].mean(axis=2))

    def to_dict(self, reading: str) -> dict[str, Any]:
        """Return mean and sd of each object on each sensor."""
        sd = self.values[reading].std(axis=2, ddof=1)
        return {
            name: {"mean": self.means(reading)[index].tolist(), "sd": sd[index].tolist()}
            for index, name in enumerate(self.names)
        }


def mean_and_range(mean: FloatArray, sd: FloatArray) -> str:
    """Return mean and sd of the median sensor, and the range of the means."""
    return f"{np.median(mean):.1f} ± {np.median(sd):.2g} ({mean.min():.1f} to {mean.max():.1f})"


def settled_readings(
    objects: Sequence[TwinObject],
    *,
    width_mm: float,
    repeats: int,
    sensors: int,
    fixture: bool = False,
    replace_each: bool = False,
) -> dict[str, Settled]:
    """Grasp each object `repeats` times at one width on each sensor; level -> what was read.

    `replace_each` places it again before every grasp, else once.
    """
    found = {}
    for level in LEVELS:
        values = {name: np.empty((len(objects), sensors, repeats)) for name in READINGS}
        for sensor in range(sensors):
            for index, obj in enumerate(objects):
                session = Session(sensor, level=level, trial=index)
                each = 1 if replace_each else repeats
                made = [
                    reading
                    for _ in range(repeats // each)
                    for reading in grasps(
                        session, obj, widths_mm=[width_mm], repeats=each, fixture=fixture
                    )[0]
                ]
                for name, of in READINGS.items():
                    values[name][index, sensor] = [of(reading) for reading in made]
        found[level] = Settled(names=tuple(obj.name for obj in objects), values=values)
    return found


def r_squared(x: FloatArray, y: FloatArray) -> float:
    """Return the squared correlation: R^2 of a line through the points.

    Examples
    --------
    >>> round(r_squared(np.array([1.0, 2, 3]), np.array([2.0, 4, 6])), 6)
    1.0
    """
    return float(np.corrcoef(x, y)[0, 1] ** 2)


def fit_lines(found: Settled, reading: str, ratings: Sequence[float]) -> FloatArray:
    """Return R^2 of the line through the objects' means, sensor by sensor."""
    rating = np.asarray(ratings, dtype=float)
    return np.array([r_squared(rating, means) for means in found.means(reading).T])


@dataclass(frozen=True, slots=True, kw_only=True)
class LineStudy:
    """A study of a line through objects of known rating.

    Attributes
    ----------
    name, title, figure : str
        On the command line, in words, and the file of its figure.
    reading : str
        Name in `READINGS` of what the published R^2 is of.
    published_r_squared : float
        Paper, section 3.2.
    ratings : sequence of float
        Of each object.
    rated : str
        What the rating is, with its unit.
    published_values : sequence of float
        The reading of each object, percent; empty if the paper prints none.
    """

    name: str
    title: str
    figure: str
    reading: str
    published_r_squared: float
    ratings: Sequence[float]
    rated: str
    published_values: Sequence[float] = ()

    def report(
        self,
        conditions: Mapping[str, Mapping[str, Settled]],
        *,
        main: str,
        provenance: Sequence[str],
        changes: tuple[str, tuple[str, ...], Sequence[Sequence[str]]],
        payload: Mapping[str, Any],
        figures: Mapping[str, Callable[[], Figure]] | None = None,
    ) -> StudyReport:
        """Compare changes and R^2 with the published ones.

        Parameters
        ----------
        conditions : mapping
            Condition -> level -> settled readings.
        main : str
            The condition whose changes are shown.
        provenance : sequence of str
            What else must be stated about the grasps.
        changes : tuple
            Title of the table of changes, its first columns, and their cells for each object.
        payload, figures : mapping
            What the study has of its own.
        """
        shown = conditions[main]
        title, columns, leads = changes
        fits = {
            condition: {
                level: {name: fit_lines(found[level], name, self.ratings) for name in READINGS}
                for level in LEVELS
            }
            for condition, found in conditions.items()
        }
        return StudyReport(
            name=self.name,
            title=self.title,
            provenance=[*provenance, CALIBRATION_INPUT],
            tables=[
                Table(
                    title=title,
                    columns=(*columns, *LEVELS),
                    rows=[
                        [*lead, *(shown[level].cell(self.reading, index) for level in LEVELS)]
                        for index, lead in enumerate(leads)
                    ],
                ),
                self._fits_table(conditions, fits),
            ],
            payload={
                "study": self.name,
                "origin": "twin",
                **payload,
                "published_r_squared": self.published_r_squared,
                "levels": {level: shown[level].to_dict(self.reading) for level in LEVELS},
                "r_squared": {
                    condition: {
                        level: {name: fit.tolist() for name, fit in each.items()}
                        for level, each in by_level.items()
                    }
                    for condition, by_level in fits.items()
                },
            },
            figures={**(figures or {}), self.figure: lambda: self._draw(shown)},
        )

    def _fits_table(
        self,
        conditions: Mapping[str, Mapping[str, Settled]],
        fits: Mapping[str, Mapping[str, Mapping[str, FloatArray]]],
    ) -> Table:
        """Return R^2 for every condition and reading: median sensor, worst and best.

        How far the readings of the first object and the last lie apart shows how much of the range
        a line has to span.
        """
        rows = []
        for condition, found in conditions.items():
            for reading in READINGS:
                first, *_, last = np.median(found[LEVELS[0]].means(reading), axis=1)
                paper = f"{self.published_r_squared:g}" if reading == self.reading else ""
                each = [fits[condition][level][reading] for level in LEVELS]
                cells = [f"{np.median(r):.3f} ({r.min():.3f} to {r.max():.3f})" for r in each]
                rows.append([condition, reading, f"{first:.3g} to {last:.3g}", paper, *cells])
        return Table(
            title="R^2 of a line through the objects' means: median sensor (worst to best)",
            columns=("condition", "reading", f"range, {LEVELS[0]}", "published", *LEVELS),
            rows=rows,
        )

    def _draw(self, found: Mapping[str, Settled]) -> Figure:
        """Draw every grasp against the rating, level by level, with each sensor's line."""
        from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, new_figure

        rating, colours = (
            np.asarray(self.ratings, dtype=float),
            (BLUE, ORANGE, GREEN, PURPLE, AMBER),
        )
        with new_figure(columns=2, width_in=9.0, height_in=3.4) as (figure, axes):
            for axis, level in zip(axes[0], LEVELS, strict=True):
                values = found[level].values[self.reading]
                for sensor, colour in zip(range(values.shape[1]), colours, strict=False):
                    points = values[:, sensor]
                    x = np.repeat(rating, points.shape[1])
                    axis.plot(x, points.ravel(), ".", color=colour, ms=4, alpha=0.4)
                    mean = points.mean(axis=1)
                    axis.plot(
                        rating,
                        np.polyval(np.polyfit(rating, mean, 1), rating),
                        color=colour,
                        lw=1,
                        label=f"sensor {sensor}: R² {r_squared(rating, mean):.2f}",
                    )
                axis.set(xlabel=self.rated, ylabel=f"{self.reading} (%)")
                axis.set_title(f"simulated, {level}")
                # Without printed points the entry alone gives the line's R².
                printed = self.published_values
                axis.plot(
                    rating[: len(printed)],
                    printed,
                    ls="",
                    marker="D" if printed else "",
                    c=INK,
                    mfc="none",
                    label=f"published: R² {self.published_r_squared:.2f}",
                )
                # Room for the legend: no height is free of readings at every level.
                lowest, highest = axis.get_ylim()
                axis.set_ylim(lowest, highest + 0.3 * (highest - lowest))
                axis.legend(loc="upper center", ncols=2, fontsize=7)
        return figure
