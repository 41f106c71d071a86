"""A gripper, an object and pads in MuJoCo, as a world for the twin's devices."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.twin.mechanics import Motion, contact_radius_mm
from palpate.twin.objects import Truth, TwinObject
from palpate.twin.world import OPEN_MM
from palpate_mujoco.hand import WIDOWX, Hand, Servo
from palpate_mujoco.object_dynamics import ObjectDynamics, add_object
from palpate_mujoco.sensor import PadSensor

#: Update period of servo, object and sheet, seconds.
EVERY_S = 0.02
#: Time after the end of a movement at which free fingers are at rest, seconds.
_AT_REST_S = 0.5


class MujocoWorld:
    """A simulated grasp in MuJoCo, advanced by its clock.

    It implements `palpate.twin.stage.Stage`, so the twin's array, gripper and load cell work with
    it as with the twin's own world. Times must not decrease.

    Parameters
    ----------
    obj : TwinObject or None
        Object between the open fingers.
    seed, sheet_seed, level
        As in `palpate_mujoco.sensor.PadSensor`.
    hand : Hand
        Model of the hand.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.twin.objects import draw_object
    >>> world = MujocoWorld(draw_object(np.random.default_rng(1), "springs-4"), seed=1)
    >>> world.drive(40.0, rate=20.0)
    40.0
    >>> world.force_n(5.0) > 1
    True
    """

    gripper: Literal["rigid", "soft"] = "rigid"

    def __init__(
        self,
        obj: TwinObject | None,
        *,
        seed: int,
        sheet_seed: int | None = None,
        level: str = "lab",
        hand: Hand = WIDOWX,
    ) -> None:
        self.seed, self.level = seed, level
        self.sheet_seed = seed if sheet_seed is None else sheet_seed
        self.clock = ManualClock()
        #: Called with the new time before the world advances, such as by a scanning array.
        self.watchers: list[Callable[[float], None]] = []
        self._hand = hand
        model = hand.spec().compile()
        self.sensor = PadSensor(
            model,
            mujoco.MjData(model),
            pads=hand.pads,
            seed=seed,
            sheet_seed=self.sheet_seed,
            level=level,
            clock=self.clock,
        )
        #: Pixels and readout, scan rate and oversampling.
        self.layout = self.sensor.layout
        self.frame_rate_hz = self.sensor.frame_rate_hz
        self.oversampling = self.sensor.oversampling
        self._motion = Motion(start_s=0.0, from_mm=OPEN_MM, to_mm=OPEN_MM, rate_mm_per_s=1.0)
        self._hold: MujocoWorld | None = None
        self._peak_n = 0.0
        self._is_sheet_stopped = False
        self._build(obj, width_mm=OPEN_MM)

    @property
    def data(self) -> mujoco.MjData:
        """State of the physics, to read or render; the world steps it."""
        return self.sensor.data

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model."""
        return self.sensor.model

    def now_s(self) -> float:
        """Return the clock's time, seconds."""
        return self.clock.now_s()

    # -- the gripper ------------------------------------------------------------------------------

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        """Command the fingers to a width (mm, mm/s); return the target."""
        if rate <= 0:
            raise ValueError(f"the fingers need a positive rate, not {rate}")
        now_s = self._advance_with_watchers(self.now_s() if time_s is None else time_s)
        self._motion = Motion(
            start_s=now_s, from_mm=self._motion.width_mm(now_s), to_mm=target, rate_mm_per_s=rate
        )
        if self._object is not None and target < self._object.obj.size_mm:
            self._hold = self._copy()
        return target

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers at their position."""
        now_s = self._advance_with_watchers(self.now_s() if time_s is None else time_s)
        self.drive(self._motion.width_mm(now_s), rate=1.0, time_s=now_s)

    def drive_value(self, time_s: float) -> float:
        """Return the current width read by the servo, mm."""
        self._advance_with_watchers(time_s)
        return self._servo.width_mm

    def is_moving(self, time_s: float) -> bool:
        """Return whether the fingers are moving."""
        return self._motion.end_s > self._advance_with_watchers(time_s)

    def place(self, obj: TwinObject | None) -> None:
        """Replace the object between the fingers; None removes it.

        Raises
        ------
        ValueError
            If the new object is larger than the opening.
        """
        now_s = self._advance_with_watchers(self.now_s())
        width_mm = self._motion.width_mm(now_s)
        if obj is not None and obj.size_mm >= width_mm:
            raise ValueError(
                f"{obj.name} is {obj.size_mm:.1f} mm and the fingers are at {width_mm:.1f} mm; "
                "open them first"
            )
        self._hold, self._peak_n = None, 0.0
        self.sensor.change_placement()
        self._build(obj, width_mm=width_mm)

    # -- state ------------------------------------------------------------------------------------

    def force_n(self, time_s: float) -> float:
        """Return the grip force: the mean of the forces on the pads."""
        self._advance_with_watchers(time_s)
        return self._grip_n

    @property
    def peak_force_n(self) -> float:
        """Largest grip force on the current object, sampled every `EVERY_S`."""
        return self._peak_n

    @property
    def is_damaged(self) -> bool:
        """Whether the force has exceeded the object's yield force."""
        dynamics = self._object
        return dynamics is not None and (dynamics.ruptured or self._peak_n >= dynamics.obj.yield_n)

    def pixel_voltage_v(self, time_s: float) -> FloatArray:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols)."""
        self._advance_with_watchers(time_s)
        return self.sensor.voltage_v()

    def stop_sheet(self) -> None:
        """Stop reading the sheet, to save time; all counts are 0 from now on."""
        self._is_sheet_stopped = True

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan of the array: counts summed over the conversions, shape (rows, cols)."""
        if self._is_sheet_stopped:
            return np.zeros((self.layout.rows, self.layout.cols), dtype=np.int32)
        self._advance(time_s)
        return self.sensor.counts()

    def truth(self, horizon_s: float = 20.0) -> Truth:
        """Return the true state, like `palpate.twin.world.World.truth`.

        A copy of the physics continues from the start of the final hold's last movement.
        """
        end = self._copy() if self._hold is None else self._hold._copy()
        end._advance(end._motion.start_s + horizon_s)
        dynamics, force_n = end._object, end._grip_n
        stiffness = None
        if dynamics is not None and force_n > 0:
            stiffness = force_n / dynamics.flattening_mm
        return Truth(
            size_mm=None if dynamics is None else dynamics.obj.size_mm,
            settled_percent=float(end.sensor.change_percent().mean()),
            force_n=force_n,
            stiffness_n_per_mm=stiffness,
            peak_force_n=self.peak_force_n,
            damaged=self.is_damaged,
        )

    # -- internals --------------------------------------------------------------------------------

    @property
    def _grip_n(self) -> float:
        return float(self.sensor.finger_n.mean())

    def _build(self, obj: TwinObject | None, *, width_mm: float) -> None:
        """Compile the hand with an object, at rest at a width."""
        spec = self._hand.spec()
        if obj is not None:
            placement = self.sensor.placement
            along_mm, across_mm = placement.off_centre_mm
            x_mm = self._hand.place_mm(
                obj.size_mm, lead_mm=placement.lead_mm, first_finger=placement.first_finger
            )
            left, right = (pad.geom for pad in self._hand.pads)
            add_object(spec, obj, place_mm=(x_mm, across_mm, along_mm), pads=(left, right))
        model = spec.compile()
        data = mujoco.MjData(model)
        data.time = self.now_s()
        self._servo = Servo(self._hand, model=model, data=data)
        self._servo.set_width(width_mm)
        self.sensor.attach(model, data)
        self._object = None if obj is None else ObjectDynamics(obj, model=model, data=data)

    def _advance_with_watchers(self, time_s: float) -> float:
        """Notify the watchers, advance to a time, and return it."""
        for watcher in self.watchers:
            watcher(time_s)
        self._advance(time_s)
        return time_s

    def _advance(self, time_s: float) -> None:
        step_s = self.model.opt.timestep
        while (left_s := time_s - self.data.time) > 0.5 * step_s:
            if self._is_still:
                # Nothing moves, and the relaxation of the sheet is exact for any time step.
                self.data.time = time_s
                self.sensor.update_now()
                return
            self._step(max(round(min(left_s, EVERY_S) / step_s), 1))

    @property
    def _is_still(self) -> bool:
        """Whether fingers and object are at rest without contact."""
        since_s = self.data.time - self._motion.end_s
        return since_s > _AT_REST_S and not self.data.ncon and not self.sensor.load_n.any()

    def _step(self, steps: int) -> None:
        """Step the physics, and update servo, object and sheet."""
        ends_s = self.data.time + steps * self.model.opt.timestep
        before_mm = self._servo.width_mm
        self._servo.move_towards(self._motion.width_mm(ends_s), within_s=ends_s - self.data.time)
        if self._object is not None:
            self._object.apply_force()
            self.sensor.reach_mm = contact_radius_mm(
                self._object.obj, self._object.flattening_mm, pitch_mm=self.layout.pitch_mm
            )
        mujoco.mj_step(self.model, self.data, steps)
        self.sensor.update_now(travel_mm=abs(self._servo.width_mm - before_mm))
        self._peak_n = max(self._peak_n, self._grip_n)

    def _copy(self) -> MujocoWorld:
        """Return an independent copy of the world, without devices."""
        other, data = copy.copy(self), copy.copy(self.data)
        other.watchers, other.sensor = [], self.sensor.copy(data)
        other._servo = Servo(self._hand, model=self.model, data=data)
        other._object = None if self._object is None else self._object.copy(data)
        return other
