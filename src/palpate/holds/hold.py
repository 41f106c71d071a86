"""One channel of one hold, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """One channel of one hold.

    Attributes
    ----------
    hold_id : str
        Name in the file.
    channel : str or None
        Pixel or signal, where a hold has several.
    time_s : ndarray, shape (n_times,)
        Strictly increasing; 0 is the actuation or the peak. Sampling may be uneven.
    values : ndarray, shape (n_times,)
        In any unit.
    unit : str or None
        Unit of the values where it is known; ``"percent"`` is a change relative to rest.
    """

    hold_id: str
    channel: str | None
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: str | None = None
