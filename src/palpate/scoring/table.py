"""The table of predictions and scores: what `palpate settle` and `palpate.score` return."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InputError
from palpate.holds import Hold
from palpate.scoring.predictions import Prediction, predict_holds, summarise
from palpate.settling.predict import find_method

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

#: Columns of text where standard output is no terminal that has a width of its own.
PIPED_WIDTH = 120

#: From this width on intervals are shown with their half-widths.
WIDE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreTable:
    """Predictions of holds, and how far off they were by method and cut-off.

    It prints as the scores that `palpate settle` prints.
    """

    #: In the order of files, holds, methods and cut-offs.
    predictions: Sequence[Prediction]
    #: Time of the settled value.
    horizon_s: float
    #: Probability that the intervals are meant to cover.
    level: float
    #: The rule of decision, where there was one.
    until_half_width_percent: float | None = None

    def groups(self) -> dict[tuple[str, float | None], list[Prediction]]:
        """Return predictions by method and cut-off (None: decided hold by hold)."""
        found: dict[tuple[str, float | None], list[Prediction]] = {}
        for row in self.predictions:
            cutoff_s = row.cutoff_s if row.decided is None else None
            found.setdefault((row.method, cutoff_s), []).append(row)
        return found

    def __str__(self) -> str:
        """Return the scores as text."""
        from rich.console import Console

        text = io.StringIO()
        print_scores(self.summary(), Console(file=text, width=PIPED_WIDTH), level=self.level)
        return text.getvalue().rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Return rows and summary as `palpate settle --json` prints them, None where unknown."""
        return {"rows": list(self.rows()), "summary": self.summary()}

    def to_dataframe(self) -> pd.DataFrame:
        """Return the summary as a data frame, a row for each method and cut-off.

        Raises `InputError` where pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise InputError("to_dataframe needs pandas; pip install pandas") from error
        return pd.DataFrame(self.summary())

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
    methods: Sequence[str] = ("relaxation", "exponential", "recorded"),
    cutoffs_s: Sequence[float] = (1.0, 2.5, 5.0),
    horizon_s: float = 20.0,
    level: float = 0.9,
) -> ScoreTable:
    """Predict holds by several methods and cut-offs, and score the predictions.

    Parameters
    ----------
    holds : iterable of Hold
        They are scored where they last until the horizon.
    methods : sequence of str
        Names that `predict_settled` takes.
    cutoffs_s : sequence of float
        Each prediction rests on samples up to one of these times, seconds.
    horizon_s : float
        Time of the value to predict, seconds.
    level : float
        Probability that the intervals are meant to cover.

    Returns
    -------
    ScoreTable
        Rows, a summary, and the text that `palpate settle` prints.

    Raises
    ------
    InputError
        If a method is not known.

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
        methods={name: find_method(name) for name in methods},
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
        rows.append(
            (
                entry["method"],
                f"~{cutoff}" if "holds_decided" in entry else cutoff,
                str(entry["holds"]),
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
        f"[dim]of rest: median |error| in % of the change still to come; in {level:.0%}: share of "
        "holds inside their interval; ±: median half-width in %[/dim]",
        highlight=False,
    )


def format_figure(figure: float | None) -> str:
    """Return a percentage or a time with as many decimals as its column can hold."""
    if figure is None or not np.isfinite(figure):
        return "-"
    if abs(figure) >= 1e4:
        return f"{figure:.2g}"
    return f"{figure:.{2 if abs(figure) < 10 else 1 if abs(figure) < 100 else 0}f}"
