"""Objects grasped at one width (section 3.2 of the paper): settled change and curves.

The paper prints no widths. Here the fingers close by the middle of Table 1's five closures.
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
from palpate_studies.twin_session import Session, grasps, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Where the published settled values are drawn: next to the end of the curves, at 20 s.
PUBLISHED_AT_S = 21.0
#: Sensor and grasps that are drawn.
SHOWN_SENSOR, SHOWN_GRASPS = 0, 5
SENSORS = 3
CLOSURE_MM = 3.0
#: The data that set the spread of the level `lab`; to be stated wherever these tables are shown.
CALIBRATION_INPUT = (
    "The level `lab` got its scatter from grasp to grasp so as to be of the size of the "
    "published standard deviations, and its sheets so as to reach such changes; the twin's objects "
    "are guesses in the ratio of their makers' ratings. So agreement of single entries shows "
    "little; order, linearity and what is lost at `field` are predictions."
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
    """Draw mean and standard deviation over a few grasps of each object, level by level.

    Parameters
    ----------
    objects : mapping of str to TwinObject
        Label -> what is grasped.
    width_mm : float
        Width that the fingers close to.
    title : str
        The figure of the paper.
    published : mapping of str to (float, float)
        Label -> published mean and standard deviation of the settled change, percent.
    fixture : bool
        Whether objects lie in the middle, within 1 mm.
    """
    from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, SKY, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        for axis, level in zip(axes[0], LEVELS, strict=True):
            drawn = zip(objects.items(), (PURPLE, GREEN, ORANGE, BLUE, SKY, AMBER), strict=False)
            for rank, ((label, obj), colour) in enumerate(drawn):
                session = Session(SHOWN_SENSOR, level=level)
                session.place(obj, fixture=fixture)
                curves = stack(
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

    `replace_each` places it again before every grasp, else once.
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


def cells_of(found: Settled, index: int) -> list[str]:
    """Return mean and sd of one object's median sensor, and the range of means."""
    each = [found[level][index] for level in LEVELS]
    return [mean_and_range(v.mean(axis=1), v.std(axis=1, ddof=1)) for v in each]


def mean_and_range(mean: FloatArray, sd: FloatArray) -> str:
    """Return mean and sd of the median sensor, and the range of the means."""
    return f"{np.median(mean):.1f} ± {np.median(sd):.2g} ({mean.min():.1f} to {mean.max():.1f})"


def as_json(found: Settled, names: Sequence[str]) -> dict[str, Any]:
    """Return mean and sd of each object on each sensor, by level."""
    return {
        level: {
            name: {"mean": one.mean(axis=1).tolist(), "sd": one.std(axis=1, ddof=1).tolist()}
            for name, one in zip(names, found[level], strict=True)
        }
        for level in LEVELS
    }


def r_squared(x: FloatArray, y: FloatArray) -> float:
    """Return the squared correlation: R^2 of a line through the points.

    Examples
    --------
    >>> round(r_squared(np.array([1.0, 2, 3]), np.array([2.0, 4, 6])), 6)
    1.0
    """
    return float(np.corrcoef(x, y)[0, 1] ** 2)


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
    ratings : mapping of str to float
        Object -> rating.
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
        """Compare changes and R^2 with the published ones.

        Parameters
        ----------
        conditions : mapping
            Condition -> settled readings.
        main : str
            The condition whose changes are shown.
        provenance : sequence of str
            What else must be stated about the grasps.
        changes : tuple
            Title of the table of changes, its first columns, and their cells for each object.
        payload, figures : mapping
            What the study has of its own.
        """
        title, columns, leads = changes
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
                Table(
                    title=title,
                    columns=(*columns, *LEVELS),
                    rows=[[*lead, *cells_of(conditions[main], k)] for k, lead in enumerate(leads)],
                ),
                Table(
                    title=f"R^2 of a line through the means, published {self.published_r_squared:g}"
                    ": median sensor (worst to best)",
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
                ),
            ],
            payload={
                "origin": "twin",
                **payload,
                "published_r_squared": self.published_r_squared,
                "levels": as_json(conditions[main], [*self.ratings]),
                "r_squared": {
                    condition: {level: {self.reading: fit} for level, fit in by_level.items()}
                    for condition, by_level in fits.items()
                },
            },
            figures={**(figures or {}), self.figure: lambda: self._draw(conditions[main])},
        )

    def _draw(self, found: Settled) -> Figure:
        """Draw every grasp against the rating, level by level, with each sensor's line."""
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
