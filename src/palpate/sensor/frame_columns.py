"""Many frames as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.health_pixels import measure_pixels
from palpate.sensor.sample import pixel_resistance_ohm


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameColumns:
    """A sequence of frames, stored as columns."""

    #: Shape (frames,). Scan times.
    time_s: FloatArray
    #: Shape (frames,). Unwrapped frame numbers.
    sequence: NDArray[np.int64]
    #: Shape (frames, rows, cols). Sums of `oversampling` conversions.
    counts: NDArray[np.int32]
    #: Conversions summed per pixel, equal in all frames.
    oversampling: int = 1

    @classmethod
    def from_frames(cls, frames: Sequence[Frame]) -> FrameColumns:
        """Return the columns of frames with equal oversampling."""
        return cls(
            time_s=np.array([frame.time_s for frame in frames]),
            sequence=np.array([frame.sequence for frame in frames], dtype=np.int64),
            counts=np.array([frame.counts for frame in frames]),
            oversampling=frames[-1].oversampling,
        )

    def to_frames(self) -> list[Frame]:
        """Return a list of single frames."""
        return [
            Frame(
                time_s=float(time_s),
                sequence=int(number),
                counts=counts,
                oversampling=self.oversampling,
            )
            for time_s, number, counts in zip(self.time_s, self.sequence, self.counts, strict=True)
        ]

    def select_first(self, duration_s: float) -> FrameColumns:
        """Return the frames of the first `duration_s` seconds."""
        count = int(np.searchsorted(self.time_s, self.time_s[0] + duration_s, side="right"))
        return replace(
            self,
            time_s=self.time_s[:count],
            sequence=self.sequence[:count],
            counts=self.counts[:count],
        )

    @property
    def mean_counts(self) -> FloatArray:
        """Counts per conversion, shape (frames, rows, cols)."""
        return np.asarray(self.counts / float(self.oversampling))

    def ohm(self, *, layout: ArrayLayout) -> FloatArray:
        """Return resistances, shape (frames, rows, cols)."""
        return pixel_resistance_ohm(self.counts, layout=layout, oversampling=self.oversampling)

    def rest_ohm(self, *, layout: ArrayLayout) -> FloatArray:
        """Return the median resistance of each pixel: inf if open, 0 if short."""
        return measure_pixels(self.mean_counts, layout=layout).rest_ohm
