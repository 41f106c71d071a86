"""The normal distribution, as intervals use it."""

from __future__ import annotations

from scipy.special import ndtri


def normal_half_width(level: float) -> float:
    """Return the half width, in standard deviations, of the central interval of a level.

    Parameters
    ----------
    level : float
        Probability of covering, 0 to 1.

    Examples
    --------
    >>> round(normal_half_width(0.9), 3)
    1.645
    """
    return float(ndtri(0.5 + level / 2))
