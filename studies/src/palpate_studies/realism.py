"""Whether the twin is ever kinder than real recordings: scatter, creep, shapes and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.holds import read_holds
from palpate.twin.ranges import ranges_of
from palpate_studies.force_ladders import read_ladders
from palpate_studies.press_data import read_presses
from palpate_studies.realism_quantities import (
    SMALLEST_N,
    halves,
    hold_quantities,
    ladder_quantities,
    log_gains,
    press_quantities,
    together,
)
from palpate_studies.realism_twin import twin_ladder, twin_presses, twin_weights
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.rows import LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SENSORS, PRESSES, HOLDS = 12, 8, 3
#: Levels whose resistance at rest is compared.
RESTING = (*LEVELS, "low-rest")
SUMMED, NEXT = "gain scatter, eight places", "gain from eight places to the next"
#: Quantity -> (source, what is compared of it). The twin's value should not be the smaller one.
COMPARED: dict[str, tuple[str, str]] = {
    "exponent": ("ladders", "sd"),
    "scatter of ln force": ("ladders", "median"),
    "ln force missed": ("ladders", "median"),
    "gain scatter": ("presses", "median"),
    SUMMED: ("presses", "median"),
    NEXT: ("presses", "median"),
    "creep, %": ("presses", "median"),
    "still to come, %": ("holds", "median"),
    "noise, %": ("holds", "median"),
    "relaxation error, %": ("holds", "median"),
    "relaxation error, % of rest": ("holds", "median"),
    "exponential error, %": ("holds", "median"),
    "exponential error, % of rest": ("holds", "median"),
}
MEANING = {
    "exponent": "of excess conductance in force, sensor by sensor",
    "scatter of ln force": "about the sensor's own power law, every weight placed again",
    "ln force missed": "by the power law of two other sensors",
    "gain scatter": "sd of ln conductance at equal force, place to place",
    SUMMED: "pressed together: drawn from all of a real sheet; the twin's eight pixels",
    NEXT: "difference / sqrt 2: real, one half of the sheet to the other; twin, placed again",
    "creep, %": "of conductance within 1 s of plateau, the force's share taken out",
    "still to come, %": "of the settled ohm value at 2.5 s",
    "noise, %": "of one sample on a settled hold",
    "relaxation error, %": "at 2.5 s, of the settled ohm value",
    "relaxation error, % of rest": "of the change still to come",
    "exponential error, %": "at 2.5 s, of the settled ohm value",
    "exponential error, % of rest": "of the change still to come",
}
Quantities = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One quantity on real recordings and on both levels of the twin."""

    quantity: str
    real: FloatArray
    twin: Mapping[str, FloatArray]

    @property
    def statistic(self) -> str:
        """Name of what is compared."""
        return COMPARED[self.quantity][1]

    def value(self, values: FloatArray) -> float:
        """Return what is compared, NaN left out."""
        return float(np.nanstd(values) if self.statistic == "sd" else np.nanmedian(values))

    def kinder(self, level: str) -> bool:
        """Return whether the twin's value lies below the 90 % interval of the real one."""
        rng = np.random.default_rng(0)
        drawn = rng.choice(self.real, size=(2000, self.real.size))
        spread = np.nanstd(drawn, axis=1)
        found = spread if self.statistic == "sd" else np.nanmedian(drawn, axis=1)
        return self.value(self.twin[level]) < float(np.quantile(found, 0.05))


def command(
    ladders: Annotated[
        Path | None, typer.Option(help="Real ladders of weights.", metavar="CSV")
    ] = None,
    presses: Annotated[
        Path | None, typer.Option(help="Real presses with a load cell.", metavar="CSV")
    ] = None,
    holds: Annotated[
        list[Path] | None,
        typer.Option(help="Real holds in ohm; may be repeated.", metavar="FILE"),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Compare the twin's scatter, creep, shapes and noise with those of real recordings.

    Example: palpate study realism --ladders ladders.csv --presses presses.csv.gz --holds holds.csv
    """
    real = real_quantities(ladders=ladders, presses=presses, holds=holds or ())
    rest_ohm = [one.rest_ohm for one in read_ladders(ladders)] if ladders else []
    report(real, rest_ohm=rest_ohm).emit(as_json=as_json, out=out)


def real_quantities(
    *, ladders: Path | None = None, presses: Path | None = None, holds: Sequence[Path] = ()
) -> dict[str, Quantities]:
    """Return the quantities of each file given."""
    found: dict[str, Quantities] = {}
    if ladders is not None:
        found[ladders.name] = ladder_quantities(
            [
                (one.load_n[loaded], one.rest_ohm / one.resistance_ohm[loaded] - 1.0)
                for one in read_ladders(ladders)
                for loaded in [one.load_n > SMALLEST_N]
            ]
        )
    if presses is not None:
        pressed = read_presses(presses)
        gains = log_gains(pressed)
        found[presses.name] = {
            **press_quantities(pressed),
            SUMMED: together(gains),
            NEXT: halves(gains),
        }
    for path in holds:
        found[path.name] = hold_quantities(read_holds(path))
    return found


def twin_quantities(*, level: str, sensors: int = SENSORS) -> dict[str, FloatArray]:
    """Return the same quantities of the twin."""
    pressed = [twin_presses(sensor, level=level, count=PRESSES) for sensor in range(sensors)]
    one, summed = ([p for pair in pressed for p in pair[part]] for part in (0, 1))
    gains = np.array(list(log_gains(summed).values()))
    return {
        **ladder_quantities([twin_ladder(sensor, level=level) for sensor in range(sensors)]),
        **press_quantities(one),
        SUMMED: np.std(gains, axis=1, ddof=1),
        NEXT: np.abs(np.diff(gains, axis=1)).ravel() / np.sqrt(2),
        **hold_quantities(
            [h for sensor in range(sensors) for h in twin_weights(sensor, level=level, count=HOLDS)]
        ),
    }


def report(
    real: Mapping[str, Quantities], *, sensors: int = SENSORS, rest_ohm: Sequence[float] = ()
) -> StudyReport:
    """Compare every quantity of every file with both levels; `rest_ohm` is of real sensors."""
    twin = {level: twin_quantities(level=level, sensors=sensors) for level in LEVELS}
    compared = {
        name: [
            Comparison(
                quantity=quantity,
                real=values,
                twin={level: twin[level][quantity] for level in LEVELS},
            )
            for quantity, values in quantities.items()
        ]
        for name, quantities in real.items()
    }
    tables = [_table(name, comparisons) for name, comparisons in compared.items()]
    if not tables:
        tables = [_twin_table(twin)]
    return StudyReport(
        name="realism",
        title="The twin compared with real recordings",
        provenance=[*_provenance(sensors, given=bool(real)), *_at_rest(rest_ohm)],
        tables=tables,
        payload={
            "study": "realism",
            "origin": "twin",
            "files": {name: [_as_json(one) for one in found] for name, found in compared.items()},
            "twin": {
                level: {name: _quantiles(values) for name, values in twin[level].items()}
                for level in LEVELS
            },
            "rest_ohm": {
                **({"real": _ends(rest_ohm) | {"sensors": len(rest_ohm)}} if rest_ohm else {}),
                **{level: _ends(ranges_of(level).rest_ohm_log) for level in RESTING},
            },
        },
        figures={"realism": lambda: draw(real, twin)},
    )


def _provenance(sensors: int, *, given: bool) -> list[str]:
    lines = [
        f"Simulated: {sensors} sensors of each level, {PRESSES} presses and {HOLDS} holds of each, "
        "read with 16 bit so that the converter adds nothing. Real: the files named.",
        "`field` is meant to be no kinder than the real recordings; its ranges were set and "
        "widened by this comparison, so agreement shows nothing about an estimator. `lab` "
        "scatters as the paper's Tables 2 to 6 do and is kinder than these recordings in many "
        "rows: results at `lab` alone are no promise for a sensor outside such a setup.",
        "Real presses visit places of a sheet that is one pixel: our pixels, one per press, stand "
        "for the places, and their sum for eight places pressed at once. Real places keep their "
        "gain from one repeat to the next (to about 0.1) and neighbours are alike, so half a "
        "sheet differs from the other half by more than eight independent places would. The twin "
        "draws its places again for each grasp, which a thing that is placed again in a gripper, "
        "and not moved by half a sheet, does not bring; weights placed again at one place "
        "(ladders) scatter less on the real sheets than on `field`.",
        "Kinder: the twin's median (or sd) lies below the bootstrap 90 % interval of the real one.",
    ]
    if not given:
        lines.append("No real recordings were given (--ladders, --presses, --holds): twin alone.")
    return lines


def _ends(values: Sequence[float]) -> dict[str, float]:
    return {"low": min(values), "high": max(values)}


def _at_rest(rest_ohm: Sequence[float]) -> list[str]:
    if not rest_ohm:
        return []
    low, high = (end / 1000 for end in ranges_of("field").rest_ohm_log)
    return [
        f"At rest these {len(rest_ohm)} real sensors of the ladders have "
        f"{min(rest_ohm) / 1000:.1f} to {max(rest_ohm) / 1000:.1f} kohm, `field` has {low:g} to "
        f"{high:g}: there the reference resistor fits. The level `low-rest` is for one that does "
        "not."
    ]


def _table(name: str, comparisons: Sequence[Comparison]) -> Table:
    rows = []
    for one in comparisons:
        cells = [f"{one.quantity}: {MEANING[one.quantity]}", one.statistic, _cell(one, one.real)]
        for level in LEVELS:
            verdict = " kinder" if one.kinder(level) else ""
            cells.append(_cell(one, one.twin[level]) + verdict)
        rows.append(cells)
    columns = ("quantity", "compared", f"real, n = {len(comparisons[0].real)}", *LEVELS)
    return Table(title=f"{name}: value compared (10 to 90 %)", columns=columns, rows=rows)


def _twin_table(twin: Mapping[str, Quantities]) -> Table:
    rows = []
    for quantity in COMPARED:
        one = Comparison(
            quantity=quantity, real=np.zeros(0), twin={k: twin[k][quantity] for k in LEVELS}
        )
        cells = [_cell(one, one.twin[level]) for level in LEVELS]
        rows.append([f"{quantity}: {MEANING[quantity]}", one.statistic, *cells])
    return Table(
        title="Twin: value compared (10 to 90 %)",
        columns=("quantity", "compared", *LEVELS),
        rows=rows,
    )


def _cell(one: Comparison, values: FloatArray) -> str:
    low, high = np.nanquantile(values, [0.1, 0.9])
    return f"{one.value(values):.3g} ({low:.3g} to {high:.3g})"


def _quantiles(values: FloatArray) -> dict[str, float]:
    low, middle, high = np.nanquantile(values, [0.1, 0.5, 0.9])
    return {
        "p10": float(low),
        "median": float(middle),
        "p90": float(high),
        "sd": float(np.nanstd(values)),
    }


def _as_json(one: Comparison) -> dict[str, Any]:
    return {
        "quantity": one.quantity,
        "statistic": one.statistic,
        "real": _quantiles(one.real),
        "kinder": {level: bool(one.kinder(level)) for level in LEVELS},
    }


def draw(real: Mapping[str, Quantities], twin: Mapping[str, Quantities]) -> Figure:
    """Draw the range of each quantity: real recordings above the twin's two levels."""
    from palpate.plots.style import AMBER, BLUE, GREY, INK, ORANGE, new_figure

    shown = [name for name in COMPARED if name != "exponential error, % of rest"]
    looks = dict(zip(LEVELS, (BLUE, ORANGE), strict=True))
    with new_figure(rows=6, columns=2, width_in=9.0, height_in=11.0) as (figure, axes):
        for axis, quantity in zip(axes.flat, shown, strict=True):
            sets = [
                (name.split(".")[0], values[quantity], (INK, GREY, AMBER)[place % 3])
                for place, (name, values) in enumerate(real.items())
                if quantity in values
            ]
            sets += [(f"twin, {level}", twin[level][quantity], looks[level]) for level in LEVELS]
            for row, (_, values, colour) in enumerate(sets):
                low, middle, high = np.nanquantile(values, [0.1, 0.5, 0.9])
                axis.plot([low, high], [row, row], color=colour, lw=3, alpha=0.4)
                axis.plot(middle, row, "o", color=colour)
            axis.set_yticks(range(len(sets)), [label for label, _, _ in sets])
            axis.set(ylim=(len(sets) - 0.5, -0.5), xlim=(0, None))
            axis.set_title(quantity, loc="left")
        figure.suptitle("10 to 90 % of each quantity, dot at the median; the twin is simulated")
    return figure
