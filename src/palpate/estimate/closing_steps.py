"""The steps of one closing as a stiffness is told from them: widths, forces, and their doubts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

#: A step that raises the force at one go is read low, because the sheet lags: by this share of the
#: rise (in ln force) that is not yet forgotten. On development closings of the twin, with the true
#: forces beside them, 0.16 on springs; 0.05 where half the things relax as fruit does meanwhile.
#: Relaxing bends a closing the other way: a stiffness, told from the bend, takes none on average.
LAG, LAG_SD = 0.1, 0.08
#: A sheet forgets this share of a rise of the force with each step of a closing.
_FORGOTTEN = 0.3
#: This contact's exponent against the law's, because the load spreads over the pixels as it grows
#: and a sheet near its end bends: scatter per unit of ln force, as a share of the law's own scatter
#: from placement to placement, and its least and most.
_TILT_SHARE, _TILT_SDS = 0.5, (0.04, 0.4)
#: The gain is told by the servo's current all along the closing, from this share of the force on
#: and the more the larger it was; the lag of the sheet is taken out there.
_TOLD_FROM = 0.3
#: A reading below so many scatters of faint forces may be drift before the contact: such a step
#: says only that the force was no larger.
FELT = 2.0
#: Steps of a long closing that are looked at: neighbours say the same.
_MOST_STEPS = 14


def unforgotten(force_n: FloatArray, *, faint_n: float) -> FloatArray:
    """Return the rise of ln force at each step that the sheet has not forgotten yet.

    Parameters
    ----------
    force_n : ndarray, shape (n_steps,)
        Forces of a closing, newtons; below `faint_n` they count as that.

    Examples
    --------
    >>> unforgotten(np.array([0.1, 0.2, 0.2]), faint_n=0.1).round(3).tolist()
    [0.0, 0.485, 0.34]
    """
    remembered, found = float(np.log(faint_n)), []
    for now in np.log(np.maximum(force_n, faint_n)):
        remembered += _FORGOTTEN * (now - remembered)
        found.append(now - remembered)
    return np.array(found)


def tilt_sd(law_sd: float) -> float:
    """Return the scatter of a contact's exponent about the law's, from the scatter of the law."""
    return float(np.clip(_TILT_SHARE * law_sd, *_TILT_SDS))


@dataclass(frozen=True, slots=True, kw_only=True)
class Looks:
    """The felt steps that are looked at, arrays of shape (looks,)."""

    #: Force read, and opening.
    read_n: FloatArray
    width_mm: FloatArray
    #: ln force, from where the gain was told.
    above: FloatArray
    #: Its rise that is not yet forgotten, beyond that of the last step.
    lagging: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingCurve:
    """The steps of one closing, read as the grasp went."""

    #: Shape (n_steps,). Opening at each step, zero taken out.
    width_mm: FloatArray
    #: Shape (n_steps,). Force read there, newtons; 0 where nothing was felt.
    force_n: FloatArray
    #: Scatter of ln force from one contact to another.
    gain_sd: float
    #: Scatter of ln force that the sheet's law shows from placement to placement.
    law_sd: float
    #: Scatter of faint forces, newtons.
    floor_n: float

    @property
    def faint_n(self) -> float:
        """Force below which a reading tells no more than that it is small."""
        return FELT * self.floor_n

    @property
    def felt(self) -> NDArray[np.bool_]:
        """Steps whose force can't be drift."""
        return self.force_n > self.faint_n

    @property
    def rising(self) -> FloatArray:
        """Rise of ln force at each felt step that the sheet has not forgotten yet."""
        return unforgotten(self.force_n[self.felt], faint_n=self.faint_n)

    @property
    def looked_at(self) -> NDArray[np.int64]:
        """Which of the felt steps are looked at: at most so many, evenly spread."""
        felt = int(np.count_nonzero(self.felt))
        return np.unique(np.linspace(0, felt - 1, min(felt, _MOST_STEPS)).round().astype(int))

    @property
    def looks(self) -> Looks:
        """What is looked at."""
        read_n = self.force_n[self.felt][self.looked_at]
        share = read_n / read_n.max()
        told = np.where(share > _TOLD_FROM, share**2, 0.0)
        above, lagging = np.log(read_n), self.rising[self.looked_at]
        return Looks(
            read_n=read_n,
            width_mm=self.width_mm[self.felt][self.looked_at],
            above=above - np.average(above, weights=told),
            lagging=lagging - lagging[-1],
        )

    @property
    def told_sd(self) -> float:
        """Doubt of the gain without what the exponent makes of it, which is solved for."""
        tilted = tilt_sd(self.law_sd) * self.looks.above[-1]
        return float(np.sqrt(max(self.gain_sd**2 - tilted**2, (0.5 * self.gain_sd) ** 2)))
