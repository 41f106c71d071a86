"""Estimated sizes of strawberries over the true ones, and the error of each way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate.plots.style import GREY, INK, look_of, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Sized(Protocol):
    """The part of a strawberry's results that is drawn."""

    @property
    def true_mm(self) -> float:
        """True size."""
        ...

    @property
    def published_mm(self) -> float:
        """The paper's way; NaN where it gives nothing."""
        ...

    @property
    def ours(self) -> Measurement | None:
        """Our estimate."""
        ...


def size_figure(
    found: Mapping[str, Sequence[Sized]], *, shown: int, published_rms_mm: float
) -> Figure:
    """Draw the first strawberries as in the paper's Figure 14, and the errors of all below.

    Parameters
    ----------
    found : mapping of str to sequence
        Level -> strawberries.
    shown : int
        How many of each level are in the upper panel.
    published_rms_mm : float
        RMS error that the paper prints.
    """
    with new_figure(rows=2, columns=len(found), width_in=4.2 * len(found), height_in=6.4) as (
        figure,
        axes,
    ):
        for column, (level, berries) in enumerate(found.items()):
            _draw_each(axes[0][column], berries[:shown])
            axes[0][column].set_title(
                f"simulated, {level}: {min(shown, len(berries))} strawberries"
            )
            _draw_errors(axes[1][column], berries)
            axes[1][column].set_title(f"simulated, {level}: errors of all {len(berries)}")
        axes[0][0].legend(loc="upper left")
        axes[0][0].set_ylabel("estimated size (mm)")
        axes[1][0].legend(loc="upper right")
        axes[1][0].set_ylabel("strawberries")
        figure.suptitle(
            "Simulated strawberries in 1 mm steps, as in Figure 14; published: RMS error "
            f"{published_rms_mm:g} mm, all ten within ±1 mm"
        )
    return figure


def _draw_each(axis: Any, berries: Sequence[Sized]) -> None:
    published, ours = look_of("recorded"), look_of("relaxation")
    ends = (30.0, 42.0)
    axis.fill_between(ends, np.subtract(ends, 1), np.add(ends, 1), color="#EEEEEE", label="±1 mm")
    axis.plot(ends, ends, color=GREY, lw=0.8)
    true_mm = [one.true_mm for one in berries]
    axis.plot(
        true_mm,
        [one.published_mm for one in berries],
        published[1],
        color=published[0],
        label="published way (Figure 13)",
    )
    measured = [(one.true_mm, one.ours) for one in berries if one.ours is not None]
    axis.errorbar(
        [true for true, _ in measured],
        [m.value for _, m in measured],
        yerr=np.array([(m.middle - m.low, m.high - m.middle) for _, m in measured])
        .reshape(-1, 2)
        .T,
        fmt=ours[1],
        color=ours[0],
        lw=1,
        ms=4,
        label="ours, 90 % interval",
    )
    axis.set(xlabel="true size (mm)", xlim=ends, ylim=(ends[0] - 1, ends[1] + 1))


def _draw_errors(axis: Any, berries: Sequence[Sized]) -> None:
    bins = np.arange(-2.5, 2.5001, 0.1)
    errors = {
        "published way": [one.published_mm - one.true_mm for one in berries],
        "ours": [one.ours.middle - one.true_mm for one in berries if one.ours is not None],
    }
    for (label, values), look in zip(errors.items(), ("recorded", "relaxation"), strict=True):
        finite = np.array(values)[np.isfinite(values)]
        axis.hist(
            np.clip(finite, -2.5, 2.5), bins=bins, color=look_of(look)[0], alpha=0.6, label=label
        )
    for edge in (-1.0, 1.0):
        axis.axvline(edge, color=INK, lw=0.8, ls=":")
    axis.yaxis.get_major_locator().set_params(integer=True)
    axis.set(xlabel="error (mm); beyond 2.5 in the last bar", xlim=(-2.5, 2.5))
