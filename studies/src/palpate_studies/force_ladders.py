"""Newtons from a sensor given three spread weights: real ladders of dead weights on Velostat."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate.holds.strict import read_table
from palpate_studies.ladder_models import MODELS, Ladder, Predicted
from palpate_studies.report import OutOption, StudyReport, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Loads at which a test ladder is given its own steps, newtons: spread over the working range. The
#: first weights of a ladder lie at the threshold of contact, where they show little.
GIVEN_N = (1.5, 4.0, 9.0)
#: Fewer loaded steps than this show no law.
MIN_STEPS = 5
#: Loads up to this are not scored.
SMALLEST_LOAD_N = 0.5
#: Forces below this count as this: no load at all would be an infinite error of the logarithm.
FLOOR_N = 0.05
LEVEL = 0.9

Rows: TypeAlias = list[dict[str, Any]]


def command(
    ladders: Annotated[Path, typer.Option(help="Ladders of weights to learn from.", metavar="CSV")],
    test_ladders: Annotated[
        Path | None,
        typer.Option(help="Ladders to predict; without, each in turn of --ladders.", metavar="CSV"),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Predict dead weights on real sensors, each given those nearest to 1.5, 4 and 9 N.

    Example: palpate study force-ladders --ladders ladders.csv
    """
    known = read_ladders(ladders)
    tested = read_ladders(test_ladders) if test_ladders else known
    rows: Rows = []
    for one in tested:
        others = [ladder for ladder in known if ladder.name != one.name]
        if not others:
            raise InputError(f"{ladders}: no ladder other than {one.name!r} to learn from; add one")
        rows += _rows(one, others, told=_nearest(one.load_n))
    _report(rows, _left_out_steps(known), figure=lambda: draw(rows)).emit(as_json=as_json, out=out)


def read_ladders(path: Path) -> list[Ladder]:
    """Read ladders `ladder,step,load_n,resistance_ohm`, in the order of the file.

    Raises
    ------
    InputError
        If the file can't be used, or a ladder has no unloaded step at its start or too few others.
    """
    table = read_table(
        path,
        columns={
            "ladder": "text",
            "step": "number",
            "load_n": "number",
            "resistance_ohm": "number",
        },
    )
    found = []
    for name in dict.fromkeys(table["ladder"].tolist()):
        mine = table["ladder"] == name
        step, load_n, ohm = (table[c][mine] for c in ("step", "load_n", "resistance_ohm"))
        where = f"{path}: ladder {name!r}"
        if (ohm <= 0).any() or (load_n < 0).any():
            raise InputError(f"{where} has a resistance of 0 ohm or a load below 0 N; fix it")
        if load_n[0] != 0:
            raise InputError(f"{where} doesn't begin unloaded; its rest resistance is unknown")
        loaded = load_n > 0
        if np.count_nonzero(loaded) < max(MIN_STEPS, len(GIVEN_N) + 2):
            raise InputError(f"{where} has fewer than {MIN_STEPS} loaded steps; add some")
        found.append(
            Ladder(
                name=name,
                step=step[loaded].astype(int),
                load_n=load_n[loaded],
                resistance_ohm=ohm[loaded],
                rest_ohm=float(ohm[0]),
            )
        )
    return found


def _nearest(load_n: FloatArray) -> NDArray[np.bool_]:
    """Return the steps whose loads are nearest to those given, each step once."""
    told = np.zeros(len(load_n), dtype=bool)
    for at_n in GIVEN_N:
        told[np.argmin(np.where(told, np.inf, np.abs(load_n - at_n)))] = True
    return told


def _rows(one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_]) -> Rows:
    rows: Rows = []
    for name, predict in MODELS.items():
        answer: Predicted = predict(one, others, told=told, level=LEVEL)
        rows += [
            {
                "ladder": one.name,
                "model": name,
                "step": int(one.step[k]),
                "load_n": float(one.load_n[k]),
                "predicted_n": float(answer.value[k]),
                "low_n": float(answer.low[k]),
                "high_n": float(answer.high[k]),
            }
            for k in np.flatnonzero((one.load_n > SMALLEST_LOAD_N) & ~told)
        ]
    return rows


def _left_out_steps(ladders: Sequence[Ladder]) -> Rows:
    """Predict every third step of each ladder from its other steps, and the other ladders."""
    rows: Rows = []
    for one in ladders:
        others = [ladder for ladder in ladders if ladder.name != one.name]
        for phase in range(3) if others else ():
            told = np.arange(len(one.load_n)) % 3 != phase
            rows += _rows(one, others, told=told)
    return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class _Score:
    error_percent: float
    log_ratio: float
    coverage: float

    @classmethod
    def of(cls, rows: Rows) -> _Score:
        load, predicted, low, high = (
            np.array([row[key] for row in rows])
            for key in ("load_n", "predicted_n", "low_n", "high_n")
        )
        return cls(
            error_percent=float(np.median(np.abs(predicted / load - 1)) * 100),
            log_ratio=float(np.median(np.abs(np.log(np.maximum(predicted, FLOOR_N) / load)))),
            coverage=float(np.mean((low <= load) & (load <= high))),
        )


def _summary(rows: Rows) -> Rows:
    summary = []
    for ladder, model in dict.fromkeys((row["ladder"], row["model"]) for row in rows):
        mine = [row for row in rows if row["ladder"] == ladder and row["model"] == model]
        every = _Score.of(mine)
        summary.append(
            {
                "ladder": ladder,
                "model": model,
                "median_abs_error_percent": every.error_percent,
                "median_abs_log_ratio": every.log_ratio,
                "coverage": every.coverage,
            }
        )
    return summary


def _table(title: str, summary: Rows) -> Table:
    keys = {
        "median_abs_error_percent": "error %",
        "median_abs_log_ratio": "abs ln ratio",
        "coverage": "coverage",
    }
    rows = [[one["ladder"], one["model"], *(f"{one[key]:.3g}" for key in keys)] for one in summary]
    rows += [
        ["mean of ladders", mean["model"], *(f"{mean[key]:.3g}" for key in keys)]
        for mean in _means(summary)
    ]
    return Table(title=title, columns=("ladder", "model", *keys.values()), rows=rows)


def _means(summary: Rows) -> Rows:
    """Return each model's figures, averaged over ladders."""
    found = []
    for model in dict.fromkeys(one["model"] for one in summary):
        mine = [one for one in summary if one["model"] == model]
        keys = [key for key in mine[0] if key not in ("ladder", "model")]
        means = {key: float(np.mean([one[key] for one in mine])) for key in keys}
        found.append({"model": model, **means})
    return found


def _report(rows: Rows, left_out: Rows, *, figure: Callable[[], Figure]) -> StudyReport:
    summary = _summary(rows)
    payload: dict[str, Any] = {
        "rows": rows,
        "summary": summary,
        "means": _means(summary),
        "level": LEVEL,
    }
    tables = [_table("New sensor, given three spread weights, medians", summary)]
    if left_out:
        payload["left_out_steps"] = {"rows": left_out, "summary": _summary(left_out)}
        tables.append(
            _table("Every third step left out, medians", payload["left_out_steps"]["summary"])
        )
    return StudyReport(
        name="force-ladders",
        title="Dead weights on real Velostat",
        provenance=(
            "Real recordings. A ladder is never learned from when it is predicted, apart from its "
            "steps nearest to 1.5, 4 and 9 N, which are not scored.",
            f"Loads above {SMALLEST_LOAD_N} N; intervals at level {LEVEL}. "
            f"Predictions below {FLOOR_N} N count as {FLOOR_N} N in ratios.",
        ),
        tables=tables,
        payload=payload,
        figures={"force-ladders": figure},
    )


LOOKS: Mapping[str, tuple[str, str]] = {
    "line": ("#8A8A8A", "v"),
    "power": ("#D55E00", "s"),
    "pooled": ("#CC79A7", "s"),
    "ours": ("#0072B2", "o"),
}


def draw(rows: Rows) -> Figure:
    """Draw prediction against load, one panel per ladder, our interval as bars."""
    from palpate.plots.style import legend_below, new_figure

    names = list(dict.fromkeys(row["ladder"] for row in rows))
    shown, columns = names[:9], min(len(names), 3)
    lines = -(-len(shown) // columns)
    with new_figure(
        rows=lines,
        columns=columns,
        width_in=2.4 * columns,
        height_in=0.4 + 2.5 * lines,
        shared=True,
    ) as (figure, panels):
        for panel in panels.flat[len(shown) :]:
            panel.set_visible(False)
        for name, panel in zip(shown, panels.flat, strict=False):
            _draw_ladder(panel, [row for row in rows if row["ladder"] == name])
            panel.set_title(name)
        for panel in panels[-1]:
            panel.set_xlabel("load (N)")
        for panel in panels[:, 0]:
            panel.set_ylabel("predicted (N)")
        legend_below(figure, panels)
    return figure


def _draw_ladder(panel: Any, rows: Rows) -> None:
    from palpate.plots.style import log_axis

    panel.plot([0.3, 15], [0.3, 15], color="#222222", lw=0.8, label="exact")
    for model, (colour, marker) in LOOKS.items():
        mine = [row for row in rows if row["model"] == model]
        load, value, low, high = (
            np.array([max(row[key], FLOOR_N) for row in mine])
            for key in ("load_n", "predicted_n", "low_n", "high_n")
        )
        if model == "ours":
            interval = f"palpate, {100 * LEVEL:.0f} % interval"
            panel.vlines(load, low, high, color=colour, alpha=0.25, lw=2, label=interval)
        panel.plot(load, value, marker, color=colour, ms=4, label=model, alpha=0.85)
    for at_n in GIVEN_N:
        panel.axvline(at_n, color="#DDDDDD", lw=2, zorder=0)
    log_axis(panel.xaxis)
    log_axis(panel.yaxis)
    panel.set(xlim=(0.45, 15), ylim=(0.2, 60))
