"""Table of predictions and scores, for `palpate settle` and `palpate.score`."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.dataframe import to_dataframe
from palpate.holds import Hold
from palpate.scoring.predictions import Prediction, predict_holds, summarise
from palpate.settling.predict import name_methods
from palpate.settling.result import SettlingMethod

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

#: Text width if standard output is not a terminal, columns.
PIPED_WIDTH = 120

#: Minimum text width for intervals with half-widths, columns.
WIDE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreTable:
    """Predictions of holds, with scores for each method and cut-off.

    The text form (`str`) is the table of scores of `palpate settle`.
    """

    #: Predictions ordered by file, hold, method and cut-off.
    predictions: Sequence[Prediction]
    #: Time of the settled value.
    horizon_s: float
    #: Nominal coverage of the intervals.
    level: float
    #: Maximum half-width of the decision rule; None for given cut-offs.
    until_half_width_percent: float | None = None

    def groups(self) -> dict[tuple[str, float | None], list[Prediction]]:
        """Return predictions by method and cut-off (None for the decision rule)."""
        found: dict[tuple[str, float | None], list[Prediction]] = {}
        for row in self.predictions:
            cutoff_s = row.cutoff_s if row.decided is None else None
            found.setdefault((row.method, cutoff_s), []).append(row)
        return found

    def __str__(self) -> str:
        """Return the scores as text."""
        from palpate.terminal_table import make_console

        text = io.StringIO()
        console = make_console(width=PIPED_WIDTH, file=text)
        print_scores(self.summary(), console, level=self.level)
        return text.getvalue().rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Return rows and summary as in `palpate settle --json`; unknown values are None."""
        return {"rows": list(self.rows()), "summary": self.summary()}

    def to_dataframe(self) -> pd.DataFrame:
        """Return the summary as a data frame, with a row for each method and cut-off.

        Raises `MissingExtraError` if pandas is not installed.
        """
        return to_dataframe(self)

    def __len__(self) -> int:
        """Return the number of methods and cut-offs."""
        return len(self.groups())

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield one mapping for each method and cut-off, so that `pd.DataFrame(table)` works."""
        return iter(self.summary())

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield one mapping for each prediction."""
        for row in self.predictions:
            cells = {
                "hold_id": row.hold_id,
                "channel": row.channel,
                "method": row.method,
                "cutoff_s": row.cutoff_s,
                "predicted": _finite_or_none(row.predicted),
                "low": _finite_or_none(row.low),
                "high": _finite_or_none(row.high),
                "settled": _finite_or_none(row.settled),
                "error_percent": _finite_or_none(row.error_percent),
                "status": str(row.status),
                "error_of_remaining_percent": _finite_or_none(row.of_remaining_percent),
                "file": row.source,
                "unit": row.unit,
            }
            if self.until_half_width_percent is not None:
                cells["decided"] = row.decided
            yield cells

    def summary(self) -> list[dict[str, Any]]:
        """Return one mapping for each method and cut-off."""
        found = []
        for (method, cutoff_s), rows in self.groups().items():
            entry: dict[str, Any] = {"method": method, "cutoff_s": cutoff_s, "holds": len(rows)}
            entry |= {name: _finite_or_none(figure) for name, figure in summarise(rows).items()}
            entry["holds_with_settled_value"] = sum(bool(np.isfinite(r.settled)) for r in rows)
            if cutoff_s is None:
                times_s = np.array([row.cutoff_s for row in rows if row.decided])
                median_s = float(np.median(times_s)) if times_s.size else None
                entry["cutoff_s"] = entry["median_decision_s"] = median_s
                entry["until_half_width_percent"] = self.until_half_width_percent
                entry["holds_decided"] = len(times_s)
            found.append(entry)
        return found


def score(
    holds: Iterable[Hold],
    *,
    methods: Sequence[str | SettlingMethod] = ("relaxation", "exponential", "recorded"),
    cutoffs_s: Sequence[float] = (1.0, 2.5, 5.0),
    horizon_s: float = 20.0,
    level: float = 0.9,
) -> ScoreTable:
    """Predict holds with several methods and cut-offs, and score the predictions.

    Parameters
    ----------
    holds : iterable of Hold
        Holds to predict. Only holds that last until the horizon are scored.
    methods : sequence of str or SettlingMethod
        Names of methods, or your own, as in `predict_settled`.
    cutoffs_s : sequence of float
        Times of the last samples that the predictions may use, seconds.
    horizon_s : float
        Time of the predicted value, seconds.
    level : float
        Nominal coverage of the intervals.

    Returns
    -------
    ScoreTable
        Predictions and scores; the text form is the table of `palpate settle`.

    Raises
    ------
    InputError
        If a method is unknown, or two have one name.

    Examples
    --------
    >>> time_s = np.arange(0, 25, 0.1)
    >>> hold = Hold(hold_id="a", channel=None, time_s=time_s, values=100 - 5 * np.log1p(time_s))
    >>> table = score([hold], methods=["recorded"], cutoffs_s=[2.5])
    >>> [round(entry["median_abs_error_percent"], 1) for entry in table.summary()]
    [10.5]
    """
    found = predict_holds(
        holds,
        methods=name_methods(methods),
        cutoffs_s=cutoffs_s,
        horizon_s=horizon_s,
        level=level,
    )
    return ScoreTable(predictions=list(found), horizon_s=horizon_s, level=level)


def _finite_or_none(figure: float) -> float | None:
    return float(figure) if np.isfinite(figure) else None


def print_scores(summary: Sequence[Mapping[str, Any]], console: Console, *, level: float) -> None:
    """Print a row for each method and cut-off of a `ScoreTable`'s summary."""
    from palpate.terminal_table import print_table

    heads = ("method", ">cut-off", ">holds", ">median", ">mean", ">p90", ">of rest")
    rows = []
    for entry in summary:
        cutoff = "-" if entry["cutoff_s"] is None else f"{entry['cutoff_s']:.3g} s"
        scored, holds = entry["holds_with_settled_value"], entry["holds"]
        rows.append(
            (
                entry["method"],
                f"~{cutoff}" if "holds_decided" in entry else cutoff,
                f"{scored} of {holds}" if scored < holds else str(holds),
                format_figure(entry["median_abs_error_percent"]),
                format_figure(entry["mean_abs_error_percent"]),
                format_figure(entry["p90_abs_error_percent"]),
                format_figure(entry["median_error_of_remaining_percent"]),
                "-" if entry["coverage"] is None else f"{entry['coverage']:.2f}",
                format_figure(entry["median_half_width_percent"]),
            )
        )
    console.print("|error| in % of the settled value", highlight=False)
    print_table((*heads, f">in {level:.0%}", ">±"), rows, console=console)
    console.print(
        f"[dim]of rest: median |error| in % of the remaining change; in {level:.0%}: fraction of "
        "holds inside their interval; ±: median half-width in %[/dim]",
        highlight=False,
    )


def format_figure(figure: float | None) -> str:
    """Return a figure as text, with two decimals below 10 and none from 100."""
    if figure is None or not np.isfinite(figure):
        return "-"
    if abs(figure) >= 1e4:
        return f"{figure:.2g}"
    return f"{figure:.{2 if abs(figure) < 10 else 1 if abs(figure) < 100 else 0}f}"
