"""Detection of pixels that fail during a grasp: open, short, stuck, or saturated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.grasp.config import PIXELS, READING
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.state import GraspState
from palpate.sensor.findings import pixel_name
from palpate.sensor.health_pixels import find_end_readings

_SEE_DOCTOR = "run `palpate doctor`"


class PixelMonitor:
    """Detects failures of the pixels that worked in the calibration.

    Open or short: a pixel that jumps to an end of its range makes the frame uncertain, and raises
    an alarm at the second such frame. A short appears in one pixel alone or while the fingers are
    at rest; a load never does either.

    Saturated: a load moves a pixel to the end of its range gradually, and changes other pixels too.
    The reading is then a lower bound. An alarm follows once most of the loaded pixels are
    saturated, because the force is then unknown.

    Stuck: a pixel unchanged in four movements of the fingers while all others change, or all pixels
    together. If the sensor flickers, the latter is also detected while the hand is at rest.

    Equal: all pixels with the same reading raise an alarm at the second frame.

    A single pixel that sticks during the hold is not detected.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._layout = plan, plan.layout
        rest_ohm = np.asarray(plan.rest_ohm, dtype=float)
        #: All arrays hold the pixels with a rest value, in this order.
        self._watched = np.isfinite(rest_ohm) & (rest_ohm > 0)
        self._names = [pixel_name(row, col) for row, col in np.argwhere(self._watched).tolist()]
        # The ratio to the reference resistor follows from the counts alone.
        self._rest = rest_ohm[self._watched] / plan.layout.divider.reference_ohm
        resting = plan.layout.divider.full_scale / (1.0 + self._rest)
        self._unlike = resting.size > 0 and float(np.ptp(resting)) >= PIXELS.min_spread_counts
        #: Largest difference between position reports of a hand at rest.
        self._rounding = READING.report_error_steps * plan.resolution
        self._equal = 0
        self._counts: NDArray[np.float64] | None = None
        self._opened = np.zeros(self._rest.shape, dtype=int)
        self._ended = np.zeros(self._rest.shape, dtype=int)
        self._shorted = np.zeros(self._rest.shape, dtype=bool)
        self._pressed = np.zeros(self._rest.shape, dtype=bool)
        #: Pixels under load in the last frame with a pixel at the short end of the range.
        self._loaded = np.zeros(self._rest.shape, dtype=bool)
        #: Movements without a change of each pixel, and of all pixels.
        self._moves = _IdleMoves(self._rest.size, least=plan.fine_step)
        self._all_moves = _IdleMoves(min(self._rest.size, 1), least=plan.fine_step)
        self._frames = self._alike = self._longest = 0
        self._closure = 0.0
        self._moved_s = -np.inf

    @property
    def is_frame_uncertain(self) -> bool:
        """Whether a pixel has just jumped to a range end; such frames are skipped."""
        sudden = (self._ended > 0) & ~self._pressed
        return bool(((self._opened > 0) | sudden).any())

    @property
    def saturation_warning(self) -> str | None:
        """Warning about pixels saturated by the load; None without any."""
        if not self._pressed.any():
            return None
        return (
            f"{self._name_first(self._pressed)} is loaded beyond its measuring range; the force "
            "may exceed the measured value; a smaller reference resistor extends the range"
        )

    def check(self, observation: Observation, state: GraspState | None = None) -> Alarm | None:
        """Process the next observation; return an alarm for a failed pixel, if any."""
        frame = observation.frame
        counts = np.asarray(frame.counts)[self._watched] / frame.oversampling
        before = counts if self._counts is None else self._counts
        changed = counts != before
        any_changed = changed.any()
        self._moves.changed |= changed
        self._all_moves.changed |= any_changed
        self._count_alike(alike=not any_changed)
        equal = self._unlike and float(np.ptp(counts)) <= 1
        self._equal = self._equal + 1 if equal else 0
        moving, closure = (
            observation.gripper.moving,
            self._plan.gripper.closure(observation.gripper),
        )
        if self._counts is not None and (moving or abs(closure - self._closure) > self._rounding):
            self._moved_s = frame.time_s
        self._closure = closure
        # A long movement at constant speed disturbs the sheet only at its ends: count it once.
        if not moving:
            self._all_moves.count(closure)
        standing = frame.time_s - self._moved_s > READING.quiet_s
        # A fast hand stops between the frames of a slow sensor, and a quiet pixel may not change in
        # so few frames.
        if standing:
            self._moves.count(closure)
        opened, ended = find_end_readings(counts, layout=self._layout)
        self._opened = (self._opened + 1) * opened
        self._ended = (self._ended + 1) * ended
        if ended.any():
            self._judge_ended(ended, counts, before, standing=standing)
        else:
            self._shorted = self._pressed = ended
        self._counts = counts
        return self._describe_fault()

    def _judge_ended(
        self,
        ended: NDArray[np.bool_],
        counts: NDArray[np.float64],
        before: NDArray[np.float64],
        *,
        standing: bool,
    ) -> None:
        """Tell pixels at the short end of the range that are short from those under load."""
        jumped = np.abs(counts - before) > PIXELS.jump_fraction * np.maximum(before, 1.0)
        if self._counts is None:
            jumped = ended
        unloaded_jump = jumped & (~_has_others(jumped) | standing)
        self._loaded = self._under_load(counts)
        short = ~_has_others(self._loaded) | unloaded_jump
        begins = self._ended == 1
        self._shorted = ended & (self._shorted | (begins & short))
        self._pressed = ended & (self._pressed | (begins & ~short & ~jumped))
        # A saturated reading is not stuck.
        self._moves.changed |= self._pressed
        self._all_moves.changed |= self._pressed.any()

    def _describe_fault(self) -> Alarm | None:
        unchanged = self._all_moves.idle >= PIXELS.stuck_moves
        if unchanged.any() or self._is_repeating:
            since = f"{self._alike} frames"
            if not self._is_repeating:
                since = f"{PIXELS.stuck_moves} movements of the fingers"
            message = (
                f"no pixel has changed in {since}; the board repeats its frames; {_SEE_DOCTOR}"
            )
            return Alarm(danger=Danger.SENSOR_LOST, message=message)
        ended = self._ended >= PIXELS.fault_frames
        failed = {
            "open": self._opened >= PIXELS.fault_frames,
            "short": ended & self._shorted,
            "stuck": self._find_stuck_pixels(),
        }
        for how, mask in failed.items():
            if mask.any():
                message = f"{self._name_first(mask)} reads {how}; {_SEE_DOCTOR}"
                return Alarm(danger=Danger.SENSOR_LOST, message=message)
        lost = ended & ~self._pressed
        if 2 * np.count_nonzero(self._pressed) > np.count_nonzero(self._loaded):
            lost = ended
        if lost.any():
            message = (
                f"{self._name_first(ended)} is loaded beyond its measuring range; force unknown"
            )
            return Alarm(danger=Danger.FORCE_LIMIT, message=message)
        if self._equal >= PIXELS.fault_frames:
            message = f"all pixels read the same value, which indicates a fault; {_SEE_DOCTOR}"
            return Alarm(danger=Danger.SENSOR_LOST, message=message)
        return None

    def _name_first(self, mask: NDArray[np.bool_]) -> str:
        return f"pixel {self._names[int(np.argmax(mask))]}"

    def _count_alike(self, *, alike: bool) -> None:
        """Count consecutive equal frames, and record the longest run."""
        self._frames += 1
        if alike:
            self._alike += 1
            return
        self._longest, self._alike = max(self._longest, self._alike), 0

    @property
    def _is_repeating(self) -> bool:
        before = self._frames - self._alike
        flickers = before >= PIXELS.max_equal_frames and self._longest <= PIXELS.fault_frames
        return flickers and self._alike > PIXELS.max_equal_frames

    def _find_stuck_pixels(self) -> NDArray[np.bool_]:
        """Return the pixels unchanged in several movements, if all others changed in the last."""
        unchanged = self._moves.idle >= PIXELS.stuck_moves
        if not unchanged.any():
            return unchanged
        rest = self._moves.idle[~unchanged]
        return np.asarray(unchanged & (rest.size > 0 and int(rest.max()) <= 1))

    def _under_load(self, counts: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the pixels under load."""
        full = self._layout.divider.full_scale
        upper = self._layout.divider.taxel_leg == "upper"
        seen = np.clip(counts if upper else full - counts, 1.0, full - 1.0)
        return np.asarray(full / seen - 1.0 < (1.0 - PIXELS.loaded_fraction) * self._rest)


class _IdleMoves:
    """Counts the movements since readings last changed.

    `least`: travel of a movement that counts, mm or kPa.
    """

    def __init__(self, readings: int, *, least: float) -> None:
        #: Movements without a change.
        self.idle = np.zeros(readings, dtype=int)
        #: Whether each reading has changed since the last movement.
        self.changed = np.zeros(readings, dtype=bool)
        self._least, self._counted_at = least, 0.0

    def count(self, closure: float) -> None:
        """Count the end of a movement, if it was long enough."""
        if abs(closure - self._counted_at) >= self._least:
            self.idle = np.where(self.changed, 0, self.idle + 1)
            self.changed = np.zeros_like(self.changed)
            self._counted_at = closure


def _has_others(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, for each pixel, whether the mask contains another pixel."""
    return np.asarray(mask.sum() - mask > 0)
