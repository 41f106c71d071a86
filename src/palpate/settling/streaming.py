"""Settled values sample by sample, for all the pixels at once, at a bounded cost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.settling.percent import for_unit
from palpate.settling.result import SettledEstimate, SettlingMethod

#: Columns kept before neighbours are averaged: 6.4 s of the paper's 15 Hz. On real holds 64, 96 and
#: 256 have the same errors at 2.5 to 10 s; fewer would blur a contact that is over in 0.2 s.
MAX_SAMPLES = 96


class SettlingStream:
    """Predictions that grow with the hold: one call per frame.

    Up to `MAX_SAMPLES` samples the predictions are those of the batch call on the same samples.
    Beyond that, neighbours are averaged in pairs, again and again, so that an update costs the same
    at 15 Hz and at 500 Hz; the newest sample is always there as it came.

    Parameters
    ----------
    channels : int
        Signals that share the sampling times: pixels, or aggregates of them.
    methods : mapping of str to SettlingMethod
        What to predict with, by the name to report.
    horizon_s : float
        Time of the value to predict, on the axis of the times pushed; later samples are not used.
    level : float
        Probability that the intervals are to cover.
    unit : str, optional
        ``"percent"`` where values are changes relative to rest, as of `predict_settled`.

    Examples
    --------
    >>> from palpate.settling.exponential import Exponential
    >>> stream = SettlingStream(channels=2, methods={"exponential": Exponential()})
    >>> for step in range(30):
    ...     time_s = step / 15
    ...     decay = np.exp(-2.0 * time_s)
    ...     found = stream.push(time_s, [5 * decay - 60, 8 * decay - 40])
    >>> found["exponential"].value.round(6).tolist()
    [-60.0, -40.0]
    """

    def __init__(
        self,
        *,
        channels: int,
        methods: Mapping[str, SettlingMethod],
        horizon_s: float = 20.0,
        level: float = 0.9,
        unit: str | None = None,
    ) -> None:
        self._methods = {name: for_unit(method, unit) for name, method in methods.items()}
        self._horizon_s = horizon_s
        self._level = level
        # Row 0 is time: it is averaged like the rest. Two columns are for what is not yet a bin.
        self._history = np.empty((channels + 1, MAX_SAMPLES + 2))
        self.restart()

    def restart(self) -> None:
        """Forget the samples: a new hold begins."""
        self._bins = 0
        self._samples_per_bin = 1
        self._waiting = np.zeros(len(self._history))
        self._waiting_samples = 0
        self._newest: FloatArray | None = None
        self._estimates: dict[str, SettledEstimate] = {}

    def push(self, time_s: float, values: ArrayLike) -> dict[str, SettledEstimate]:
        """Add one sample of every channel and predict.

        Parameters
        ----------
        time_s : float
            Later than the last, seconds.
        values : array_like, shape (channels,)
            Finite.

        Returns
        -------
        dict of str to SettledEstimate
            By method; arrays of shape (channels,).

        Raises
        ------
        InputError
            (a `ValueError`) If time goes back, a value is not finite, or their number is wrong.
        """
        sample = np.append(time_s, np.asarray(values, dtype=np.float64))
        self._check(sample)
        if time_s > self._horizon_s and self._newest is not None:
            return self._estimates
        if self._newest is not None:
            self._fold(self._newest)
        self._newest = sample
        columns = self._bins
        if self._waiting_samples:
            self._history[:, columns] = self._waiting / self._waiting_samples
            columns += 1
        self._history[:, columns] = sample
        known = self._history[:, : columns + 1]
        self._estimates = {
            name: method.predict(known[0], known[1:], horizon_s=self._horizon_s, level=self._level)
            for name, method in self._methods.items()
        }
        return self._estimates

    def _check(self, sample: FloatArray) -> None:
        if sample.shape != (len(self._history),):
            raise InputError(f"{sample.size - 1} values for {len(self._history) - 1} channels")
        if not np.isfinite(sample).all():
            raise InputError(f"sample at {sample[0]:g} s: not every value is a finite number")
        if self._newest is not None and sample[0] <= self._newest[0]:
            raise InputError(
                f"sample at {sample[0]:g} s came after that of {self._newest[0]:g} s; times must "
                "increase: call restart() between holds"
            )

    def _fold(self, sample: FloatArray) -> None:
        """Let a sample that is no longer the newest become a bin, or part of one."""
        self._waiting += sample
        self._waiting_samples += 1
        if self._waiting_samples < self._samples_per_bin:
            return
        self._history[:, self._bins] = self._waiting / self._waiting_samples
        self._bins += 1
        self._waiting[:] = 0.0
        self._waiting_samples = 0
        if self._bins == MAX_SAMPLES:
            pairs = self._history[:, :MAX_SAMPLES].reshape(len(self._history), -1, 2)
            self._bins //= 2
            self._history[:, : self._bins] = pairs.mean(axis=2)
            self._samples_per_bin *= 2
