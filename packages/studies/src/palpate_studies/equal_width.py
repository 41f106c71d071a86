"""Objects grasped at one width (section 3.2 of the paper): settled change and curves.

The paper prints no widths. The closure used here is the middle one of Table 1's five closures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.signal.relative import mean_change
from palpate.twin.objects import TwinObject
from palpate_studies.report import StudyReport, Table
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import Session, grasps, stack_holds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Position of the published settled values in the figure: just after the curves, which end at 20 s.
PUBLISHED_AT_S = 21.0
#: Sensor and number of grasps in the figure.
SHOWN_SENSOR, SHOWN_GRASPS = 0, 5
SENSORS = 3
CLOSURE_MM = 3.0
#: Origin of the scatter at the level `lab`; every report with these tables must state it.
CALIBRATION_INPUT = (
    "At the level `lab`, the scatter from grasp to grasp was set to the size of the published "
    "standard deviations, and the sheets were set to reach such changes. The twin's objects are "
    "guesses in the ratio of their manufacturers' ratings. Agreement of single entries therefore "
    "shows little; the order, the linearity and the loss at `field` are predictions."
)
#: Reading -> attribute of `Reading`.
READINGS = {"mean change": "mean_percent", "largest change": "largest_percent"}
#: Level -> settled readings, percent, of shape (objects, sensors, repeats).
Settled: TypeAlias = Mapping[str, FloatArray]


def draw_curves(
    objects: Mapping[str, TwinObject],
    *,
    width_mm: float,
    title: str,
    published: Mapping[str, tuple[float, float]],
    fixture: bool = False,
) -> Figure:
    """Draw mean and standard deviation over a few grasps of each object, by level.

    Parameters
    ----------
    objects : mapping of str to TwinObject
        Label -> object to grasp.
    width_mm : float
        Closing width.
    title : str
        The figure of the paper.
    published : mapping of str to (float, float)
        Label -> published mean and standard deviation of the settled change, percent.
    fixture : bool
        Whether a fixture centres the objects within 1 mm.
    """
    from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, SKY, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        for axis, level in zip(axes[0], LEVELS, strict=True):
            drawn = zip(objects.items(), (PURPLE, GREEN, ORANGE, BLUE, SKY, AMBER), strict=False)
            for rank, ((label, obj), colour) in enumerate(drawn):
                session = Session(SHOWN_SENSOR, level=level)
                session.place(obj, fixture=fixture)
                curves = stack_holds(
                    [
                        mean_change(session.hold(obj.size_mm, width_mm=width_mm))
                        for _ in range(SHOWN_GRASPS)
                    ]
                )
                time_s = np.arange(1, curves.shape[1] + 1) / session.world.frame_rate_hz
                mean, sd = curves.mean(axis=0), curves.std(axis=0, ddof=1)
                axis.fill_between(time_s, mean - sd, mean + sd, color=colour, alpha=0.25, lw=0)
                axis.plot(time_s, mean, "--", color=colour, label=label)
                at_s = PUBLISHED_AT_S + 0.5 * rank
                axis.errorbar(at_s, *published[label], fmt="o", ms=4, color=colour, capsize=2)
            axis.set(
                xlabel="time from actuation (s)",
                ylabel="mean relative change (%)",
                title=f"{title}, simulated, level {level}",
                ylim=(-102, 25),
            )
            axis.errorbar(
                [], [], [], fmt="o", ms=4, color=INK, capsize=2, label="published, mean ± sd"
            )
        axes[0, 0].legend(ncols=2, loc="upper right", fontsize=7)
    return figure


def measure_settled_readings(
    objects: Sequence[TwinObject],
    *,
    reading: str,
    width_mm: float,
    repeats: int,
    sensors: int,
    fixture: bool = False,
    replace_each: bool = False,
) -> Settled:
    """Grasp each object `repeats` times at one width on each sensor of each level.

    `replace_each` places the object again before every grasp; otherwise it is placed once.
    """
    found, each = {}, 1 if replace_each else repeats
    for level in LEVELS:
        found[level] = np.empty((len(objects), sensors, repeats))
        for sensor, (index, obj) in product(range(sensors), enumerate(objects)):
            session = Session(sensor, level=level, trial=index)
            found[level][index, sensor] = [
                getattr(one, READINGS[reading])
                for _ in range(repeats // each)
                for one in grasps(
                    session, obj, widths_mm=[width_mm], repeats=each, fixture=fixture
                )[0]
            ]
    return found


def format_cells(found: Settled, index: int) -> list[str]:
    """Return an object's table cells: mean and sd of the median sensor, range of means."""
    each = [found[level][index] for level in LEVELS]
    return [format_mean_and_range(v.mean(axis=1), v.std(axis=1, ddof=1)) for v in each]


def format_mean_and_range(mean: FloatArray, sd: FloatArray) -> str:
    """Format mean and sd of the median sensor, and the range of the means."""
    return f"{np.median(mean):.1f} ± {np.median(sd):.2g} ({mean.min():.1f} to {mean.max():.1f})"


def summarise_sensors(found: Settled, names: Sequence[str]) -> dict[str, Any]:
    """Return mean and sd of each object on each sensor, by level."""
    return {
        level: {
            name: {"mean": one.mean(axis=1).tolist(), "sd": one.std(axis=1, ddof=1).tolist()}
            for name, one in zip(names, found[level], strict=True)
        }
        for level in LEVELS
    }


def r_squared(x: FloatArray, y: FloatArray) -> float:
    """Return the squared correlation, which is the R^2 of a fitted line.

    Examples
    --------
    >>> round(r_squared(np.array([1.0, 2, 3]), np.array([2.0, 4, 6])), 6)
    1.0
    """
    return float(np.corrcoef(x, y)[0, 1] ** 2)


def _table_changes(
    found: Settled, title: str, columns: tuple[str, ...], leads: Sequence[Sequence[str]]
) -> Table:
    """Return a table of the changes of each object, after its first cells."""
    rows = [[*lead, *format_cells(found, k)] for k, lead in enumerate(leads)]
    return Table(title=title, columns=(*columns, *LEVELS), rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class LineStudy:
    """A study that fits a line to the readings of objects with known ratings.

    Attributes
    ----------
    name, title, figure : str
        Name on the command line, title of the report, file stem of the figure.
    reading : str
        Reading of the published R^2, a key of `READINGS`.
    published_r_squared : float
        R^2 from section 3.2 of the paper.
    ratings : mapping of str to float
        Object -> rating.
    rated : str
        Name and unit of the rating.
    published_values : sequence of float
        Published reading of each object, percent; empty if none is printed.
    """

    name: str
    title: str
    figure: str
    reading: str
    published_r_squared: float
    ratings: Mapping[str, float]
    rated: str
    published_values: Sequence[float] = ()

    def report(
        self,
        conditions: Mapping[str, Settled],
        *,
        main: str,
        provenance: Sequence[str],
        changes: tuple[str, tuple[str, ...], Sequence[Sequence[str]]],
        payload: Mapping[str, Any],
        figures: Mapping[str, Callable[[], Figure]] | None = None,
    ) -> StudyReport:
        """Compare changes and R^2 with the published values.

        Parameters
        ----------
        conditions : mapping
            Condition -> settled readings.
        main : str
            Condition of the table of changes.
        provenance : sequence of str
            Statements about the grasps.
        changes : tuple
            Title of the table of changes, its first columns, and their cells for each object.
        payload, figures : mapping
            Additional entries of this study.
        """
        rating = np.array([*self.ratings.values()])
        fits = {
            condition: {
                level: [r_squared(rating, means) for means in found[level].mean(axis=2).T]
                for level in LEVELS
            }
            for condition, found in conditions.items()
        }
        return StudyReport(
            name=self.name,
            title=self.title,
            provenance=[*provenance, CALIBRATION_INPUT],
            tables=[
                _table_changes(conditions[main], *changes),
                self._table_fits(fits),
            ],
            payload={
                "origin": "twin",
                **payload,
                "published_r_squared": self.published_r_squared,
                "levels": summarise_sensors(conditions[main], [*self.ratings]),
                "r_squared": {
                    condition: {level: {self.reading: fit} for level, fit in by_level.items()}
                    for condition, by_level in fits.items()
                },
            },
            figures={**(figures or {}), self.figure: lambda: self._draw(conditions[main], main)},
        )

    def _table_fits(self, fits: Mapping[str, Mapping[str, Sequence[float]]]) -> Table:
        """Return a table of R^2, by condition and level."""
        return Table(
            title=f"R^2 of a line through the means, published {self.published_r_squared:g}: "
            "median sensor (worst to best)",
            columns=("condition", *LEVELS),
            rows=[
                [
                    condition,
                    *(
                        f"{np.median(r):.3f} ({min(r):.3f} to {max(r):.3f})"
                        for r in by_level.values()
                    ),
                ]
                for condition, by_level in fits.items()
            ],
        )

    def _draw(self, found: Settled, condition: str) -> Figure:
        """Draw every grasp over the rating with each sensor's line, one panel per level."""
        from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, new_figure

        rating = np.array([*self.ratings.values()])
        colours = (BLUE, ORANGE, GREEN, PURPLE, AMBER)
        with new_figure(columns=2, width_in=9.0, height_in=3.4) as (figure, axes):
            for axis, level in zip(axes[0], LEVELS, strict=True):
                sensors = zip(np.moveaxis(found[level], 1, 0), colours, strict=False)
                for sensor, (points, colour) in enumerate(sensors):
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
                axis.set_title(f"simulated, {level}, {condition}")
                # Without printed values the legend entry still shows the published R².
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
                # Make room for the legend above the readings.
                lowest, highest = axis.get_ylim()
                axis.set_ylim(lowest, highest + 0.3 * (highest - lowest))
                axis.legend(loc="upper center", ncols=2, fontsize=7)
        return figure
