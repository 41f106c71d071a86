"""`palpate.plot_holds`: figure of holds with their forecasts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.holds import Hold
from palpate.plots.settle import Panel, settle_figure
from palpate.plots.style import save_figure
from palpate.settling.percent import adapt_method
from palpate.settling.predict import CUTOFF_S, name_methods
from palpate.settling.result import SettlingMethod

#: Maximum number of holds in a figure; more panels would not be legible.
MOST_HOLDS = 9


def plot_holds(
    holds: Sequence[Hold],
    path: str | os.PathLike[str],
    *,
    cutoff_s: float = CUTOFF_S,
    horizon_s: float = 20.0,
    method: str | SettlingMethod | Sequence[str | SettlingMethod] = "relaxation",
    level: float = 0.9,
) -> None:
    """Draw holds with their forecasts, and write the figure.

    Parameters
    ----------
    holds : sequence of Hold
        At least one; the first nine are drawn. The unit and loading time of the first apply to all.
    path : path
        Output file; the suffix determines the format: .png, .svg or .pdf.
    cutoff_s, horizon_s, level
        As in `palpate.predict_settled`.
    method : str, SettlingMethod, or a sequence of them, optional
        Methods as in `palpate.predict_settled`; each hold shows the forecasts of all.

    Raises
    ------
    InputError
        If there is no hold, or the method or format is unknown.
    MissingExtraError
        If matplotlib is not installed.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> time_s = np.arange(0.0, 20.0, 0.1)
    >>> hold = Hold(hold_id="a", channel=None, time_s=time_s, values=40.0 - 2.0 * np.log1p(time_s))
    >>> file = tempfile.mkdtemp() + "/holds.png"
    >>> plot_holds([hold], file, method=["relaxation", "exponential"])
    """
    if not holds:
        raise InputError("no hold to plot; give at least one")
    one: Any = method
    is_several = isinstance(method, Sequence) and not isinstance(method, str)
    methods = name_methods(one if is_several else [one])
    if not methods:
        raise InputError("no method to plot; give at least one, such as 'relaxation'")
    drawn = holds[:MOST_HOLDS]
    figure = settle_figure(
        [Panel(title=hold.hold_id, hold=hold, cutoff_s=cutoff_s) for hold in drawn],
        methods={name: adapt_method(one, unit=drawn[0].unit) for name, one in methods.items()},
        horizon_s=horizon_s,
        level=level,
    )
    save_figure(figure, Path(path))
