"""Changes against rest as an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: The change that is white; at rest a pixel is black.
WHITE_PERCENT = -100.0
#: A pixel that does not read: no change has a colour.
UNREAD_RGB = (255, 0, 0)


def picture(change_percent: NDArray[np.float64], *, width: int, height: int) -> NDArray[np.uint8]:
    """Return an image in which each pixel of the sensor is an even area.

    Parameters
    ----------
    change_percent : ndarray, shape (rows, cols)
        Relative to rest, percent; NaN where a pixel does not read.
    width, height : int
        Whole multiples of cols and rows.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Grey from black (rest, or above) to white (-100 %), red where nothing was read.

    Examples
    --------
    >>> picture(np.array([[0.0, -50.0, np.nan]]), width=3, height=1).tolist()
    [[[0, 0, 0], [128, 128, 128], [255, 0, 0]]]
    """
    rows, cols = change_percent.shape
    unread = np.isnan(change_percent)
    depth = np.clip(np.where(unread, 0.0, change_percent) / WHITE_PERCENT, 0.0, 1.0)
    grey = np.rint(255 * depth).astype(np.uint8)
    small = np.repeat(grey[:, :, None], 3, axis=2)
    small[unread] = UNREAD_RGB
    return np.repeat(np.repeat(small, height // rows, axis=0), width // cols, axis=1)
