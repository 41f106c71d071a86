"""Relative changes of the pixels as an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Change of a white pixel; a pixel at rest is black.
WHITE_PERCENT = -100.0
#: Colour of a pixel without a reading; changes are grey.
UNREAD_RGB = (255, 0, 0)


def render_image(
    change_percent: NDArray[np.float64], *, width: int, height: int
) -> NDArray[np.uint8]:
    """Return an image with one uniform area per pixel of the sensor.

    Parameters
    ----------
    change_percent : ndarray, shape (rows, cols)
        Change relative to rest, percent; NaN for pixels without a reading.
    width, height : int
        Integer multiples of cols and rows.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Grey from black (rest or above) to white (-100 %), red for pixels without a reading.

    Examples
    --------
    >>> render_image(np.array([[0.0, -50.0, np.nan]]), width=3, height=1).tolist()
    [[[0, 0, 0], [128, 128, 128], [255, 0, 0]]]
    """
    rows, cols = change_percent.shape
    unread = np.isnan(change_percent)
    depth = np.clip(np.where(unread, 0.0, change_percent) / WHITE_PERCENT, 0.0, 1.0)
    grey = np.rint(255 * depth).astype(np.uint8)
    small = np.repeat(grey[:, :, None], 3, axis=2)
    small[unread] = UNREAD_RGB
    return np.repeat(np.repeat(small, height // rows, axis=0), width // cols, axis=1)
