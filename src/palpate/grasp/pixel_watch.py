"""Pixels that fail during a grasp: open, shorted, or stuck at what they last read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.grasp.belief import Observation
from palpate.grasp.plan import Plan
from palpate.sensor.findings import pixel_name
from palpate.sensor.health_pixels import at_ends

#: An end of the range must be read so often in a row: a joint that flickers once is no dead pixel.
_FRAMES = 2
#: A pixel is under load when it has lost this share of its resistance, and has jumped when its
#: reading changed by this share from one frame to the next.
_LOADED, _JUMP = 0.5, 0.05
#: Every movement of the fingers shakes each pixel's reading, contact or not. One that has slept
#: through so many, while no other one slept through more than `_OTHERS` of them, is stuck.
_MOVES, _OTHERS = 8, 3


class PixelWatch:
    """Watches the pixels that the calibration knows; what it did not read is not missed.

    An open or a short is known at its second frame. A sheet pressed beyond the converter's range
    reads like a short: it is one if no other pixel is under load, or if it jumped there alone. A
    pixel that sticks in the middle of its range is known after eight movements of the fingers; one
    that sticks later, in the squeeze or the hold, is not known here.

    Parameters
    ----------
    plan : Plan
        Its layout, rest resistances and steps.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._layout = plan, plan.layout
        rest_ohm = np.asarray(plan.rest_ohm, dtype=float)
        self._known = np.isfinite(rest_ohm) & (rest_ohm > 0)
        # Resistance over reference: what the counts tell without it.
        self._rest = np.where(self._known, rest_ohm, 1.0) / plan.layout.divider.reference_ohm
        self._counts: NDArray[np.float64] | None = None
        self._opened = np.zeros(rest_ohm.shape, dtype=int)
        self._shorted = np.zeros(rest_ohm.shape, dtype=int)
        self._slept = np.zeros(rest_ohm.shape, dtype=int)
        self._shaken = np.zeros(rest_ohm.shape, dtype=bool)
        self._counted_at = 0.0

    def complaint(self, observation: Observation) -> str | None:
        """Take the next observation; say which pixel failed and how, None if none did."""
        frame = observation.frame
        counts = np.asarray(frame.counts, dtype=float) / frame.oversampling
        before = counts if self._counts is None else self._counts
        self._counts = counts
        self._shaken |= counts != before
        # A long way at one speed shakes the sheet at its ends only: it is one movement.
        if not observation.gripper.moving:
            self._count_moves(self._plan.gripper.closure(observation.gripper))
        opened, shorted = at_ends(counts, layout=self._layout)
        self._opened = np.where(opened, self._opened + 1, 0)
        jumped = self._known & (np.abs(counts - before) > _JUMP * np.maximum(before, 1.0))
        begins = ~self._others_pressed(counts) | (jumped & ~_others(jumped))
        self._shorted = np.where(shorted & (begins | (self._shorted > 0)), self._shorted + 1, 0)
        failed = {
            "open": self._opened >= _FRAMES,
            "short": self._shorted >= _FRAMES,
            "stuck": self._stuck(),
        }
        for how, mask in failed.items():
            if (mask & self._known).any():
                row, col = np.argwhere(mask & self._known)[0].tolist()
                return f"pixel {pixel_name(row, col)} reads {how}; see what `palpate doctor` says"
        return None

    def _count_moves(self, closure: float) -> None:
        """Count the movements that each pixel has slept through."""
        if abs(closure - self._counted_at) >= self._plan.fine_step:
            self._slept = np.where(self._shaken, 0, self._slept + 1)
            self._shaken = np.zeros_like(self._shaken)
            self._counted_at = closure

    def _stuck(self) -> NDArray[np.bool_]:
        asleep = self._known & (self._slept >= _MOVES)
        others = self._slept[self._known & ~asleep]
        quiet = others.size == 0 or others.max() > _OTHERS
        return np.zeros_like(asleep) if quiet else asleep

    def _others_pressed(self, counts: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return, for each pixel, whether another one is under load."""
        full = self._layout.divider.full_scale
        upper = self._layout.divider.taxel_leg == "upper"
        seen = np.clip(counts if upper else full - counts, 1.0, full - 1.0)
        return _others(self._known & (full / seen - 1.0 < (1.0 - _LOADED) * self._rest))


def _others(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, for each pixel, whether the mask holds for another one."""
    return np.asarray(mask.sum() - mask > 0)
