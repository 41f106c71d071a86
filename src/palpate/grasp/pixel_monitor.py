"""Detection of pixels that fail during a grasp: open, short, stuck, or saturated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.grasp.config import PIXELS, READING
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
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

    Stuck: a pixel that is exactly unchanged in eleven frames, while the ln resistance of every
    other pixel has changed so much that the same change would have been four counts in this one.

    Repeated: all pixels exactly unchanged over a travel of four steps, until the hand has come to
    rest. If the sensor flickers, eleven equal frames suffice.

    Equal: all pixels with the same reading raise an alarm at the second frame.
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
        #: Frames without a change of each pixel.
        self._unchanged = np.zeros(self._rest.shape, dtype=int)
        #: Lowest and highest ln resistance of each pixel since the last change of the quietest one.
        self._lowest = self._highest = np.full(self._rest.shape, np.nan)
        #: Closure at the last change of any pixel.
        self._changed_at = 0.0
        self._frames = self._alike = self._longest = 0
        self._closure = 0.0
        #: Last frame with a change of the reported position, and with a reported movement.
        self._moved_s = self._moving_s = -np.inf

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

    def check(self, observation: Observation) -> Alarm | None:
        """Process the next observation; return an alarm for a failed pixel, if any."""
        frame = observation.frame
        counts = np.asarray(frame.counts)[self._watched] / frame.oversampling
        before = counts if self._counts is None else self._counts
        changed = counts != before
        self._count_alike(alike=not changed.any())
        equal = self._unlike and float(np.ptp(counts)) <= 1
        self._equal = self._equal + 1 if equal else 0
        closure = self._plan.gripper.closure(observation.gripper)
        is_moved = observation.gripper.moving or abs(closure - self._closure) > self._rounding
        if self._counts is not None and is_moved:
            self._moved_s = frame.time_s
        self._closure = closure
        standing = frame.time_s - self._moved_s > READING.quiet_s
        opened, ended = find_end_readings(counts, layout=self._layout)
        self._opened = (self._opened + 1) * opened
        self._ended = (self._ended + 1) * ended
        if ended.any():
            self._judge_ended(ended, counts, before, standing=standing)
        else:
            self._shorted = self._pressed = ended
        self._counts = counts
        # A saturated reading is not stuck.
        self._follow_changes(counts, changed | self._pressed)
        if changed.any() or self._pressed.any() or self._frames == 1:
            self._changed_at = closure
        if observation.gripper.moving:
            self._moving_s = frame.time_s
        # At constant speed a quiet sheet may not change, but any stop disturbs it.
        stopped = frame.time_s - self._moving_s > READING.quiet_s
        blind = stopped and abs(closure - self._changed_at) >= PIXELS.stuck_steps * self._plan.step
        return self._describe_fault(is_blind=blind)

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
        self._loaded = self._ratios(counts) < (1.0 - PIXELS.loaded_fraction) * self._rest
        short = ~_has_others(self._loaded) | unloaded_jump
        begins = self._ended == 1
        self._shorted = ended & (self._shorted | (begins & short))
        self._pressed = ended & (self._pressed | (begins & ~short & ~jumped))

    def _follow_changes(self, counts: NDArray[np.float64], changed: NDArray[np.bool_]) -> None:
        """Count each pixel's unchanged frames, and follow all since the quietest one's change."""
        if not counts.size:
            return
        log_ohm = np.log(self._ratios(counts))
        is_first = self._frames == 1
        if is_first or changed[int(np.argmax(self._unchanged))]:
            self._lowest = self._highest = log_ohm
        self._unchanged = np.where(changed | is_first, 0, self._unchanged + 1)
        self._lowest = np.minimum(self._lowest, log_ohm)
        self._highest = np.maximum(self._highest, log_ohm)

    def _describe_fault(self, *, is_blind: bool) -> Alarm | None:
        if self._is_repeating or is_blind:
            message = (
                f"no pixel has changed in {self._alike} frames; the board repeats its frames; "
                f"{_SEE_DOCTOR}"
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
        """Return the quietest pixel if it would have changed with the least of the others."""
        stuck = np.zeros(self._rest.shape, dtype=bool)
        if self._rest.size < 2 or self._counts is None:
            return stuck
        quietest = int(np.argmax(self._unchanged))
        others = np.delete(self._highest - self._lowest, quietest)
        counts, full = self._counts[quietest], self._layout.divider.full_scale
        expected = float(others.min()) * counts * (1.0 - counts / full)
        long = self._unchanged[quietest] > PIXELS.max_equal_frames
        stuck[quietest] = long and expected >= PIXELS.stuck_counts
        return stuck

    def _ratios(self, counts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the resistances relative to the reference resistor, at most those of the ends."""
        full = self._layout.divider.full_scale
        upper = self._layout.divider.taxel_leg == "upper"
        return full / np.clip(counts if upper else full - counts, 1.0, full - 1.0) - 1.0


def _has_others(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, for each pixel, whether the mask contains another pixel."""
    return np.asarray(mask.sum() - mask > 0)
