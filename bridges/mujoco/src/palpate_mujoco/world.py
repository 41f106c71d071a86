"""A gripper, an object and pads in MuJoCo, as a stage for the twin's devices."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.twin.mechanics import Motion, patch_reach_mm
from palpate.twin.objects import Truth, TwinObject
from palpate.twin.world import OPEN_MM
from palpate_mujoco.hand import WIDOWX, Hand, Servo
from palpate_mujoco.sensor import PadSensor
from palpate_mujoco.thing import Thing, add_object

#: How often servo, object and sheet are brought up to date, seconds.
EVERY_S = 0.02
#: Fingers that touch nothing have come to rest so long after their way's end, seconds.
_STILL_S = 0.5


class MujocoWorld:
    """A simulated grasp in MuJoCo, advanced by whoever holds its clock.

    A stage as `palpate.twin.stage.Stage` describes it: the twin's array, gripper and load cell work
    on it as they do on the twin's own world. Times asked for must not go backwards.

    Parameters
    ----------
    obj : TwinObject or None
        What lies between the open fingers.
    seed, sheet_seed, level
        As in `palpate_mujoco.sensor.PadSensor`.
    hand : Hand
        The model of the hand.

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
        #: Called with the time before the world moves on to it (an array scanning on its own).
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
        #: Pixels and readout, and how they are scanned.
        self.layout = self.sensor.layout
        self.frame_rate_hz = self.sensor.frame_rate_hz
        self.oversampling = self.sensor.oversampling
        self._motion = Motion(start_s=0.0, from_mm=OPEN_MM, to_mm=OPEN_MM, rate_mm_per_s=1.0)
        self._hold: MujocoWorld | None = None
        self._peak_n = 0.0
        self._build(obj, width_mm=OPEN_MM)

    @property
    def data(self) -> mujoco.MjData:
        """State of the physics: read it, render it; the world steps it."""
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
        """Send the fingers to a width (mm, mm/s). Returns the target."""
        if rate <= 0:
            raise ValueError(f"the fingers need a positive rate, not {rate}")
        now_s = self._at(self.now_s() if time_s is None else time_s)
        self._motion = Motion(
            start_s=now_s, from_mm=self._motion.width_mm(now_s), to_mm=target, rate_mm_per_s=rate
        )
        if self._thing is not None and target < self._thing.obj.size_mm:
            self._hold = self._copy()
        return target

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers where they are."""
        now_s = self._at(self.now_s() if time_s is None else time_s)
        self.drive(self._motion.width_mm(now_s), rate=1.0, time_s=now_s)

    def drive_value(self, time_s: float) -> float:
        """Return the present width as the servo reads it, mm."""
        self._at(time_s)
        return self._servo.width_mm

    def is_moving(self, time_s: float) -> bool:
        """Return whether the fingers are on their way."""
        return self._motion.end_s > self._at(time_s)

    def place(self, obj: TwinObject | None) -> None:
        """Take the object away and put another (or none) between the fingers.

        Raises
        ------
        ValueError
            If the fingers are closer than the new object is large.
        """
        now_s = self._at(self.now_s())
        width_mm = self._motion.width_mm(now_s)
        if obj is not None and obj.size_mm >= width_mm:
            raise ValueError(
                f"{obj.name} is {obj.size_mm:.1f} mm and the fingers are at {width_mm:.1f} mm; "
                "open them first"
            )
        self._hold, self._peak_n = None, 0.0
        self.sensor.renew()
        self._build(obj, width_mm=width_mm)

    # -- what is there ----------------------------------------------------------------------------

    def force_n(self, time_s: float) -> float:
        """Return the grip force: the mean of what presses on the pads."""
        self._at(time_s)
        return self._grip_n

    @property
    def peak_force_n(self) -> float:
        """Largest grip force on the present object so far, looked at every `EVERY_S`."""
        return self._peak_n

    @property
    def is_damaged(self) -> bool:
        """Whether the force ever passed the object's yield force."""
        thing = self._thing
        return thing is not None and (thing.ruptured or self._peak_n >= thing.obj.yield_n)

    def pixel_voltage_v(self, time_s: float) -> FloatArray:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols)."""
        self._at(time_s)
        return self.sensor.voltage_v()

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan of the array: counts summed over the conversions, shape (rows, cols)."""
        self._advance(time_s)
        return self.sensor.counts()

    def truth(self, horizon_s: float = 20.0) -> Truth:
        """Return what really holds, as `palpate.twin.world.World.truth` does.

        The physics is copied at the start of the final hold's last movement and runs on from there.
        """
        end = self._copy() if self._hold is None else self._hold._copy()
        end._advance(end._motion.start_s + horizon_s)
        thing, force_n = end._thing, end._grip_n
        stiffness = None
        if thing is not None and force_n > 0:
            stiffness = force_n / thing.flattening_mm
        return Truth(
            size_mm=None if thing is None else thing.obj.size_mm,
            settled_percent=float(end.sensor.change_percent().mean()),
            force_n=force_n,
            stiffness_n_per_mm=stiffness,
            peak_force_n=self.peak_force_n,
            damaged=self.is_damaged,
        )

    # -- inside -----------------------------------------------------------------------------------

    @property
    def _grip_n(self) -> float:
        return float(self.sensor.finger_n.mean())

    def _build(self, obj: TwinObject | None, *, width_mm: float) -> None:
        """Compile the hand with an object, at rest at a width, at the clock's time."""
        spec = self._hand.spec()
        if obj is not None:
            lies = self.sensor.placement
            along_mm, across_mm = lies.off_centre_mm
            x_mm = self._hand.place_mm(
                obj.size_mm, lead_mm=lies.lead_mm, first_finger=lies.first_finger
            )
            left, right = (pad.geom for pad in self._hand.pads)
            add_object(spec, obj, place_mm=(x_mm, across_mm, along_mm), pads=(left, right))
        model = spec.compile()
        data = mujoco.MjData(model)
        data.time = self.now_s()
        self._servo = Servo(self._hand, model=model, data=data)
        self._servo.put(width_mm)
        self.sensor.attach(model, data)
        self._thing = None if obj is None else Thing(obj, model=model, data=data)

    def _at(self, time_s: float) -> float:
        """Advance to a time, let the watchers see what comes before it, and return it."""
        for watcher in self.watchers:
            watcher(time_s)
        self._advance(time_s)
        return time_s

    def _advance(self, time_s: float) -> None:
        step_s = self.model.opt.timestep
        while (left_s := time_s - self.data.time) > 0.5 * step_s:
            if self._still:
                # The physics would change nothing, and the sheet's fading is exact at any length.
                self.data.time = time_s
                self.sensor.take_in()
                return
            self._step(max(round(min(left_s, EVERY_S) / step_s), 1))

    @property
    def _still(self) -> bool:
        """Whether fingers and object are at rest, apart from each other."""
        since_s = self.data.time - self._motion.end_s
        return since_s > _STILL_S and not self.data.ncon and not self.sensor.load_n.any()

    def _step(self, steps: int) -> None:
        """Step the physics, with servo, object and sheet in step with it."""
        ends_s = self.data.time + steps * self.model.opt.timestep
        before_mm = self._servo.width_mm
        self._servo.head_for(self._motion.width_mm(ends_s), within_s=ends_s - self.data.time)
        if self._thing is not None:
            self._thing.resist()
            self.sensor.reach_mm = patch_reach_mm(
                self._thing.obj, self._thing.flattening_mm, pitch_mm=self.layout.pitch_mm
            )
        mujoco.mj_step(self.model, self.data, steps)
        self.sensor.take_in(travel_mm=abs(self._servo.width_mm - before_mm))
        self._peak_n = max(self._peak_n, self._grip_n)

    def _copy(self) -> MujocoWorld:
        """Return a world that continues from here on its own, without devices."""
        other, data = copy.copy(self), copy.copy(self.data)
        other.watchers, other.sensor = [], self.sensor.copy(data)
        other._servo = Servo(self._hand, model=self.model, data=data)
        other._thing = None if self._thing is None else self._thing.copy(data)
        return other
