"""Force now of one calibrated sheet on a gripper, in newtons, without being told.

ln force = law(L) + creep . (L - its low-passed copies) + travel and backlash terms, where L is the
logarithm of a reading that hardly depends on how the load spreads over the pixels, and the law
rises everywhere (see `sheet_memory`). Two doubts remain: a gain that this contact has and another
one would not have, and an error that wanders. A Kalman filter carries both; servo current, where
the gripper reports one, or a force told, narrows them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from palpate.errors import CalibrationError
from palpate.estimate.creep import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.estimate.sheet_current import Current, current_from_dict
from palpate.estimate.sheet_memory import SheetMemory, SheetReading, terms_count
from palpate.settling.result import Status

#: Where a contact's own gain is quoted: ln of 3 N, the middle of a grasp's forces.
MIDDLE_LOG_N = float(np.log(3.0))
#: So many frames after a stop the spike of the movement is over.
_CALM = 3
#: Between two stops the force goes in a line of the width, but for so much.
_LINE_SHARE = 0.03
#: Fainter forces tell nothing of a contact's gain.
_FIRM_N = 1.0
#: Linearisations of one reading: the force is an exponential of its errors.
_ITERATIONS = 3
#: Correlation time of the error that wanders, seconds: two of the longest dwells, as hysteresis and
#: slow creep last until the force changes much.
DRIFT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetModel:
    """What the guided traces taught of one sheet; see `observer_sheet_fit.fit_sheet`.

    Attributes
    ----------
    reading : SheetReading
        From pixels to one number.
    knots : tuple of float
        Where the law may bend, in L.
    time_constants_s : tuple of float
        Of the creep states; empty for a static law.
    weights : tuple of float
        Of the terms of `SheetMemory`.
    gain_sd, slope_sd, drift_sd : float
        Of ln force: of a contact's own gain, of its own exponent (per unit of ln force away from
        `MIDDLE_LOG_N`), and of the error that wanders within a contact.
    floor_n : float
        Error of a faint force, newtons: added to the wandering one.
    tail, tail_with_current : float
        Scale intervals so that they cover at their level, from the sheet alone and with current.
    range : tuple of float
        Smallest and largest L of the calibration.
    unloading_seen : bool
        Whether traces fell far enough to learn from; without, the backlash term is 0.
    current : Current or None
        Where the servo reports a current that follows the force.
    """

    reading: SheetReading
    knots: tuple[float, ...]
    time_constants_s: tuple[float, ...]
    weights: tuple[float, ...]
    gain_sd: float
    slope_sd: float
    drift_sd: float
    floor_n: float
    tail: float
    tail_with_current: float
    range: tuple[float, float]
    unloading_seen: bool
    current: Current | None

    def log_force(self, terms: FloatArray) -> FloatArray:
        """Return ln force of terms, shape (..., n_terms)."""
        return np.asarray(terms @ np.asarray(self.weights))

    def away(self, log_force: ArrayLike) -> FloatArray:
        """Return how far a force is from where a contact's gain is quoted, in ln force."""
        return np.clip(np.asarray(log_force, dtype=float) - MIDDLE_LOG_N, -3.0, 3.0)

    def wandering_sd(self, log_force: ArrayLike) -> FloatArray:
        """Return the scatter of the error that wanders: of ln force, large where it is faint."""
        # A faint force is known to a factor of e at worst: beyond, logarithms say nothing.
        faint = np.minimum(self.floor_n * np.exp(-np.asarray(log_force, dtype=float)), 1.0)
        return np.asarray(np.hypot(self.drift_sd, faint))

    def sd(self, log_force: ArrayLike) -> FloatArray:
        """Return the scatter of ln force that the sheet alone leaves."""
        own = np.hypot(self.gain_sd, self.slope_sd * self.away(log_force))
        return np.asarray(np.hypot(own, self.wandering_sd(log_force)))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file."""
        return asdict(self)


def sheet_model_from_dict(stored: dict[str, Any]) -> SheetModel:
    """Return the model that `SheetModel.as_dict` wrote.

    Raises
    ------
    CalibrationError
        If a value is missing or unknown, or the terms are those of another version.
    """
    try:
        current = stored["current"]
        model = SheetModel(
            **{
                **stored,
                "reading": SheetReading(**stored["reading"]),
                "knots": tuple(stored["knots"]),
                "time_constants_s": tuple(stored["time_constants_s"]),
                "weights": tuple(stored["weights"]),
                "range": (stored["range"][0], stored["range"][1]),
                "current": None if current is None else current_from_dict(current),
            }
        )
    except (KeyError, TypeError) as error:
        raise CalibrationError(f"observer: {error}; calibrate again") from error
    expected = terms_count(knots=model.knots, time_constants_s=model.time_constants_s)
    if len(model.weights) != expected:
        raise CalibrationError(
            f"observer: {len(model.weights)} weights where this version has {expected} terms; "
            "calibrate again"
        )
    return model


class SheetObserver:
    """Follow the force of one calibrated sheet from the first contact on, frame by frame.

    Parameters
    ----------
    model : SheetModel
        Learned from the guided traces.
    level : float
        Level of the intervals.

    Examples
    --------
    A sheet without memory whose summed excess, plus 0.1, is the force:

    >>> model = SheetModel(reading=SheetReading(exponent=1.0, touch=0.0), knots=(0.0,),
    ...     time_constants_s=(), weights=(0.0, 1.0, 1.0), gain_sd=0.1, slope_sd=0.1,
    ...     drift_sd=0.05, floor_n=0.02, tail=1.0, tail_with_current=1.0, range=(-1.0, 3.0),
    ...     unloading_seen=True, current=None)
    >>> now = SheetObserver(model).step(0.0, [1.0, 0.9])
    >>> round(now.value, 3), now.low < 1.8, str(now.status)
    (2.0, True, 'ok')
    """

    def __init__(self, model: SheetModel, *, level: float = 0.9) -> None:
        self._model, self._level = model, level
        self._half_widths = float(norm.ppf(0.5 + level / 2))
        self._memory = SheetMemory(
            model.reading, knots=model.knots, time_constants_s=model.time_constants_s
        )
        self._last_s = float("nan")
        # Errors of ln force: a contact's own gain and exponent, and one that wanders (in its own
        # standard deviations, which grow as the force gets faint); last, the motor's warmth.
        warmth_sd = 0.0 if model.current is None else model.current.warmth_sd
        self._mean = np.zeros(4)
        self._covariance = np.diag(np.square([model.gain_sd, model.slope_sd, 1.0, warmth_sd]))
        # Readings of the current on the way (N, mm) and since; the last frame's way, current and
        # width; width and ln force at the last stop.
        self._on_way: list[tuple[float, float]] = []
        self._last = (0, float("nan"), float("nan"))
        self._since_stop: list[float] = []
        self._rested: tuple[float, float] | None = None
        self._witnessed = False
        self._log_force, self._in_range = -np.inf, False

    def step(
        self,
        time_s: float,
        excess: ArrayLike,
        *,
        width_mm: float = float("nan"),
        current_ma: float = float("nan"),
    ) -> Measurement:
        """Take one frame, with the gripper's state at its time, and return the force now.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (pixels,)
            Excess conductance of each pixel.
        width_mm, current_ma : float
            As the gripper reports them; NaN where it does not.
        """
        terms = self._memory.step(time_s, excess, width_mm=width_mm)
        model = self._model
        self._log_force = float(model.log_force(terms))
        self._in_range = model.range[0] <= self._memory.log_reading <= model.range[1]
        self._wander(time_s)
        if model.current is not None and np.isfinite(current_ma):
            self._witness(model.current, current_ma, width_mm)
        return self._now()

    def tell(self, force_n: float) -> None:
        """Take a reference force at the time of the last frame.

        Raises
        ------
        ValueError
            If the force isn't above 0.
        """
        if not force_n > 0:
            raise ValueError("the force told must be above 0 N")
        self._see(
            force_n, sd_n=0.01 * force_n, at=self._log_force, reach=self._reach(self._log_force)
        )

    def _witness(self, current: Current, current_ma: float, width_mm: float) -> None:
        """Take the current of the way once it is over, and what the gears hold at the stop.

        A frame was on the way if the next one has moved on the same way.
        """
        (last_way, last_ma, last_mm), way = self._last, self._memory.way
        self._last = (way, current_ma, width_mm)
        if way:
            self._since_stop = []
            if last_way == way:
                seen_n = float(current.force_n(last_ma, way=way, width_mm=last_mm))
                self._on_way.append((seen_n, last_mm))
            return
        self._since_stop.append(float(current.force_n(current_ma)))
        if len(self._since_stop) == _CALM:
            self._hear_way(current, width_mm)
            self._hear_stop(current)
        if len(self._since_stop) >= _CALM:
            self._rested = (width_mm, self._log_force)

    def _hear_way(self, current: Current, width_mm: float) -> None:
        """Take what was read on the way to this stop, if there was anything.

        On the way itself the sheet is disturbed; so its force goes in a line from stop to stop.
        """
        readings, self._on_way = np.array(self._on_way).reshape(-1, 2), []
        if self._rested is None or not len(readings) or width_mm == self._rested[0]:
            return
        from_mm, log_from = self._rested
        done = (readings[:, 1] - from_mm) / (width_mm - from_mm)
        inside = (done > 0) & (done < 1)
        ends_n = np.exp(np.clip([log_from, self._log_force], -7.0, 7.0))
        # From or to a faint force contact may have begun or ended on the way: no line.
        if not inside.any() or ends_n.min() < _FIRM_N:
            return
        half = float(done[inside].mean())
        at_n = float(ends_n @ [1.0 - half, half])
        way = 1 if width_mm < from_mm else -1
        scatter_n = np.hypot(current.way_sd_n(at_n, way=way), _LINE_SHARE * at_n)
        sd_n = float(np.hypot(scatter_n, current.sd_n / np.sqrt(inside.sum())))
        self._hear(float(readings[inside, 0].mean()), sd_n=sd_n, at=float(np.log(at_n)))

    def _hear_stop(self, current: Current) -> None:
        """Take what the gears hold at this stop, once: it does not change until the next."""
        at = self._log_force
        expected_n = float(np.exp(np.clip(at - self._reach(at) @ self._mean, -7.0, 7.0)))
        if expected_n < _FIRM_N:
            return
        sd_n = float(np.hypot(current.stuck_sd_n(expected_n), current.sd_n / np.sqrt(_CALM)))
        self._hear(float(np.mean(self._since_stop)), sd_n=sd_n, at=at)

    def _hear(self, seen_n: float, *, sd_n: float, at: float) -> None:
        """Take a force that the current tells where the sheet says `at` (ln force)."""
        self._witnessed = True
        # A warm motor gives less force for its current: what is seen is too much.
        reach = self._reach(at) - np.array([0.0, 0.0, 0.0, 1.0])
        self._see(seen_n, sd_n=sd_n, at=at, reach=reach)

    def _wander(self, time_s: float) -> None:
        """Let the wandering error forget."""
        if np.isfinite(self._last_s):
            keep = float(np.exp(-(time_s - self._last_s) / DRIFT_S))
            scale = np.array([1.0, 1.0, keep, 1.0])
            self._mean = self._mean * scale
            self._covariance = self._covariance * np.outer(scale, scale)
            self._covariance[2, 2] += 1.0 - keep**2
        self._last_s = time_s

    def _reach(self, log_force: float) -> FloatArray:
        """How far each error state enters ln force where the sheet says so much."""
        model = self._model
        wandering = float(model.wandering_sd(log_force))
        return np.array([1.0, float(model.away(log_force)), wandering, 0.0])

    def _see(self, seen_n: float, *, sd_n: float, at: float, reach: FloatArray) -> None:
        """Correct the errors by one reading of the force, linearised where it leads (iterated)."""
        before, state = self._mean, self._mean
        for _ in range(_ITERATIONS):
            expected_n = float(np.exp(np.clip(at - reach @ state, -7.0, 7.0)))
            slope = -expected_n * reach
            spread = self._covariance @ slope
            variance = float(slope @ spread) + sd_n**2
            surprise_n = seen_n - expected_n - slope @ (before - state)
            state = before + spread / variance * surprise_n
        self._mean = state
        self._covariance = self._covariance - np.outer(spread, spread) / variance

    def _now(self) -> Measurement:
        reach = self._reach(self._log_force)
        log_force = self._log_force - float(reach @ self._mean)
        sd = float(np.sqrt(max(float(reach @ self._covariance @ reach), 0.0)))
        tail = self._model.tail_with_current if self._witnessed else self._model.tail
        half = self._half_widths * tail * sd
        return Measurement(
            value=float(np.exp(log_force)),
            low=float(np.exp(log_force - half)),
            high=float(np.exp(log_force + half)),
            unit="n",
            level=self._level,
            status=Status.OK if self._in_range else Status.SATURATED,
        )
