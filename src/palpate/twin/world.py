"""A simulated world: an object, a gripper, a sheet and its readout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.twin.friction import AT_REST, N_PER_G, Pull
from palpate.twin.mechanics import HandCompliance, Motion, RelaxingForce
from palpate.twin.objects import Truth, TwinObject
from palpate.twin.placement import PixelGrid
from palpate.twin.plant import Plant, PlantState
from palpate.twin.ranges import draw_uniform, ranges_of
from palpate.twin.readout import Readout
from palpate.twin.velostat import Environment, Sheet, draw_sheet

GripperKind: TypeAlias = Literal["rigid", "soft"]

#: Opening of the fingers at the start, mm (WidowX 250s: 74 mm), and force at which its servo locks.
OPEN_MM, LOCK_FORCE_N = 74.0, 60.0
#: Soft fingers: free closing per kPa, and compliance.
SOFT_MM_PER_KPA, SOFT_MM_PER_N = 1.4, 3.5


class World:
    """A simulated grasp, advanced by the owner of its clock.

    Requested times must not decrease. The physics is a deterministic function of the seeds and the
    commands and is not affected by readings. Noise is drawn for each frame.

    `obj`: object between the open fingers, or None.
    `seed`: seed of this session: placements, variation between grasps, noise.
    `sheet_seed`: seed of the sensor and the gripper, equal in worlds that share them; `seed` by
        default.
    `level` ("lab" or "field"): level of the random variation (`palpate.twin.ranges`).
    `gripper` ("rigid" or "soft"): width-driven fingers, or pneumatic fingers driven by pressure.
    `layout`: pixels and readout; by default the paper's for this kind of gripper. Floating idle
        lines cause crosstalk.
    `clock`: clock advanced by the devices; a new clock by default.
    `family`: relaxation family of the sheet (`palpate.twin.velostat.FAMILIES`); drawn by default.
    `environment`: temperature, humidity and earlier use.
    `replace_sheet`: returns the sheet to use instead of the drawn sheet, such as another law.
    `soft_mm_per_n`: compliance of soft fingers.
    `has_partial_slip`: whether a pulled contact shifts before it slides (`palpate.twin.friction`).

    >>> import numpy as np
    >>> from palpate.twin.objects import draw_object
    >>> world = World(draw_object(np.random.default_rng(1), "springs-4"), seed=1)
    >>> world.drive(40.0, rate=20.0)
    40.0
    >>> world.force_n(5.0) > 1
    True
    >>> world.truth().force_n < 25
    True
    """

    def __init__(
        self,
        obj: TwinObject | None,
        *,
        seed: int,
        sheet_seed: int | None = None,
        level: str = "lab",
        gripper: GripperKind = "rigid",
        layout: ArrayLayout | None = None,
        clock: ManualClock | None = None,
        frame_rate_hz: float = 15.0,
        oversampling: int = 1,
        family: str | None = None,
        environment: Environment | None = None,
        replace_sheet: Callable[[Sheet], Sheet] | None = None,
        soft_mm_per_n: float = SOFT_MM_PER_N,
        has_partial_slip: bool = True,
    ) -> None:
        self.seed = seed
        self.sheet_seed = seed if sheet_seed is None else sheet_seed
        if layout is None:
            layout = RIGID_LAYOUT if gripper == "rigid" else SOFT_LAYOUT
        self.level, self.gripper, self.layout = level, gripper, layout
        self.clock = clock if clock is not None else ManualClock()
        self.frame_rate_hz, self.oversampling = frame_rate_hz, oversampling
        #: Called with the new time before the world advances to it (for sensors that scan).
        self.watchers: list[Callable[[float], None]] = []
        ranges = ranges_of(level)
        rng = np.random.default_rng([self.sheet_seed, 0])
        sheet = draw_sheet(rng, layout=layout, level=level, family=family)
        self.sheet = sheet if replace_sheet is None else replace_sheet(sheet)
        finger_mm_per_n = draw_uniform(rng, ranges.finger_mm_per_n)
        self.compliance = HandCompliance(
            finger_mm_per_n=finger_mm_per_n + (soft_mm_per_n if gripper == "soft" else 0.0),
            pad_travel_mm=draw_uniform(rng, ranges.pad_travel_mm),
            pad_force_n=draw_uniform(rng, ranges.pad_force_n),
        )
        #: Backlash of the servo; soft fingers have none.
        self.backlash_mm = 0.0
        if gripper == "rigid":
            self.backlash_mm = draw_uniform(rng.spawn(1)[0], ranges.backlash_mm)
        self._plant = Plant(
            sheet=self.sheet,
            compliance=self.compliance,
            grid=PixelGrid.from_layout(layout),
            ranges=ranges,
            seed=seed,
            environment=environment or Environment(),
            lock_force_n=LOCK_FORCE_N if gripper == "rigid" else np.inf,
            backlash_mm=self.backlash_mm,
            has_partial_slip=has_partial_slip,
        )
        start_s = self.clock.now_s()
        self._node: PlantState
        self._next: PlantState
        self._latest: PlantState
        self._restart(self._plant.at_rest(time_s=start_s, width_mm=OPEN_MM, obj=obj))
        self._hold: PlantState | None = None
        self._damaged_s: float | None = None
        #: Time at which the object first slid along the pads; None if it never did.
        self.slid_at_s: float | None = None
        self._readout = Readout(
            sheet=self.sheet,
            layout=layout,
            oversampling=oversampling,
            adc_noise_counts=ranges.adc_noise_counts,
            seed=seed,
            start_s=start_s,
        )

    def now_s(self) -> float:
        """Return the clock's time, seconds."""
        return self.clock.now_s()

    # -- the gripper ------------------------------------------------------------------------------

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        """Start a movement to a width (mm, mm/s) or pressure (kPa, kPa/s); return the target.

        `time_s`: the clock's time by default.
        """
        if rate <= 0:
            raise ValueError(f"rate is {rate}, but must be positive")
        now = self._advance_and_notify(self.clock.now_s() if time_s is None else time_s)
        if self.gripper == "rigid":
            self._start_motion(now, target, rate)
        else:
            self._start_motion(now, OPEN_MM - SOFT_MM_PER_KPA * target, rate * SOFT_MM_PER_KPA)
        return target

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers in place."""
        now = self._advance_and_notify(self.clock.now_s() if time_s is None else time_s)
        self._start_motion(now, now.motion.width_mm(now.time_s), 1.0)

    def drive_value(self, time_s: float) -> float:
        """Return the present width (mm) or pressure (kPa)."""
        width_mm = self._advance_and_notify(time_s).motion.width_mm(time_s)
        return width_mm if self.gripper == "rigid" else (OPEN_MM - width_mm) / SOFT_MM_PER_KPA

    def is_moving(self, time_s: float) -> bool:
        """Return whether the fingers are moving."""
        return self._advance_and_notify(time_s).motion.end_s > time_s

    def place(
        self,
        obj: TwinObject | None,
        *,
        time_s: float | None = None,
        fixture: bool = False,
    ) -> None:
        """Replace the object between the fingers with another object, or remove it.

        Removal is always possible; a new object requires a wider opening of the fingers. A fixture
        centres the object on the pixels and between the fingers; otherwise its position is random.

        Raises `ValueError` if the new object is larger than the opening.
        """
        now = self._advance_and_notify(self.clock.now_s() if time_s is None else time_s)
        width_mm = now.motion.width_mm(now.time_s)
        if obj is not None and obj.size_mm >= width_mm:
            raise ValueError(
                f"{obj.name} is {obj.size_mm:.1f} mm and the fingers are at {width_mm:.1f} mm; "
                "open them first"
            )
        self._hold = self._damaged_s = self.slid_at_s = None
        if fixture:
            self._plant.placements.fixtures.add(now.placed + 1)
        moving = now.motion.end_s > now.time_s
        still = Motion(start_s=now.time_s, from_mm=width_mm, to_mm=width_mm, rate_mm_per_s=1.0)
        self._restart(
            replace(
                now,
                motion=now.motion if moving else still,
                obj=obj,
                placed=now.placed + 1,
                closure_mm=-np.inf if obj is None else obj.size_mm - now.finger_mm,
                squeeze=RelaxingForce.at_rest(obj),
                peak_force_n=0.0,
                ruptured=False,
                pull=None,
                slide=AT_REST,
            )
        )

    def lift(
        self,
        *,
        more_n: float = 0.0,
        rise_s: float = 0.0,
        n_per_mm: float = 0.0,
        time_s: float | None = None,
    ) -> None:
        """Lift the object off its support, so that only friction holds the object.

        `more_n`: pull in addition to the weight, such as that of a tearing stem or a hand. Opening
        the fingers first puts the object down again.
        `rise_s`: time in which this pull rises linearly; at once by default.
        `n_per_mm`: stiffness of what pulls (`palpate.twin.friction.Pull`); 0 is a dead load.
        """
        now = self._advance_and_notify(self.clock.now_s() if time_s is None else time_s)
        if now.obj is not None:
            pull = Pull(
                weight_n=N_PER_G * now.obj.mass_g,
                more_n=more_n,
                start_s=now.time_s,
                rise_s=rise_s,
                n_per_mm=n_per_mm,
            )
            self._restart(replace(now, pull=pull))

    def stop_sheet(self) -> None:
        """Stop computing the sheet, to save time; all counts are 0 from now on.

        The forces are as before.
        """
        self._plant.follows_sheet = False

    @property
    def slid_mm(self) -> float:
        """Distance by which the object has slid along the pads since its placement."""
        return self._latest.slide.slid_mm

    @property
    def has_dropped(self) -> bool:
        """Whether the object has slid out of the fingers since its placement."""
        return self._latest.slide.is_off_pads

    def set_environment(self, environment: Environment, *, time_s: float | None = None) -> None:
        """Change the climate, the suction or the earlier use immediately.

        `environment.cycles` excludes the contacts of this world, unless `cycles_are_all`.
        """
        now = self._advance_and_notify(self.clock.now_s() if time_s is None else time_s)
        self._plant.environment = environment
        self._restart(now)

    # -- quantities -------------------------------------------------------------------------------

    def force_n(self, time_s: float) -> float:
        """Return the grip force that a load cell would measure."""
        return self._advance_and_notify(time_s).force_n

    def pixel_resistance_ohm(self, time_s: float) -> FloatArray:
        """Return the noise-free resistance of each pixel, shape (rows, cols)."""
        return self._ohm(self._advance_and_notify(time_s))

    def pixel_voltage_v(self, time_s: float) -> FloatArray:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols).

        Includes the noise of the sheet and any crosstalk, but not the noise of the converter.
        """
        return self._readout.sample_volts(
            self._ohm(self._advance_and_notify(time_s)), time_s=time_s
        )

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan of the array: counts summed over the conversions, shape (rows, cols)."""
        if not self._plant.follows_sheet:
            return np.zeros((self.layout.rows, self.layout.cols), dtype=np.int32)
        return self._readout.sample_counts(self._ohm(self._advance(time_s)), time_s=time_s)

    def truth(self, horizon_s: float = 20.0) -> Truth:
        """Return the true values `horizon_s` after the start of the final hold's last movement.

        The final hold follows the last command that left the object held. A noise-free copy of the
        world continues from there with the gripper at rest and without a pull.
        """
        now = self._node if self._hold is None else self._hold
        # A tightened grip may still lose the object, whose truth remains available.
        end = self._plant.run(replace(now, pull=None), now.motion.start_s + horizon_s)
        ohm = self._plant.resistance_ohm(end)
        rest = self._plant.rest_ohm
        deformation_mm = end.closure_mm - self.compliance.deflection_mm(end.force_n)
        obj, peak_force_n = end.obj, self._latest.peak_force_n
        return Truth(
            size_mm=None if obj is None else obj.size_mm,
            settled_percent=float(100.0 * np.mean(ohm / rest - 1.0)),
            force_n=end.force_n,
            stiffness_n_per_mm=end.force_n / deformation_mm if end.force_n > 0 else None,
            peak_force_n=peak_force_n,
            damaged=obj is not None and (self._latest.ruptured or peak_force_n >= obj.yield_n),
            damaged_s=self._damaged_s,
        )

    # -- inside -----------------------------------------------------------------------------------

    def _ohm(self, state: PlantState) -> FloatArray:
        resistance = self._plant.resistance_ohm(state)
        return resistance.reshape(self.layout.rows, self.layout.cols)

    def _advance_and_notify(self, time_s: float) -> PlantState:
        """Advance to a time, notify watchers of earlier events, and return the state."""
        for watcher in self.watchers:
            watcher(time_s)
        return self._advance(time_s)

    def _advance(self, time_s: float) -> PlantState:
        if time_s < self._node.time_s - 1e-9:
            raise ValueError(
                f"the world is at {self._node.time_s:.4f} s and can't go back to {time_s:.4f} s"
            )
        if time_s == self._latest.time_s:
            return self._latest
        while self._next.time_s <= time_s:
            self._node, self._next = self._next, self._plant.advance_to_next_node(self._next)
            if self.slid_at_s is None and self._node.slide.slid_mm > 0:
                self.slid_at_s = self._node.time_s
        self._latest = self._node
        if time_s > self._node.time_s:
            self._latest = self._plant.interpolate(self._node, self._next, time_s)
        obj = self._latest.obj
        if self._damaged_s is None and obj is not None:
            is_damaged = self._latest.ruptured or self._latest.peak_force_n >= obj.yield_n
            self._damaged_s = time_s if is_damaged else None
        return self._latest

    def _restart(self, state: PlantState) -> None:
        self._node, self._next = state, self._plant.advance_to_next_node(state)
        self._latest = state

    def _start_motion(self, now: PlantState, to_mm: float, rate_mm_per_s: float) -> None:
        motion = Motion(
            start_s=now.time_s,
            from_mm=now.motion.width_mm(now.time_s),
            to_mm=to_mm,
            rate_mm_per_s=rate_mm_per_s,
        )
        opens = to_mm > now.motion.width_mm(now.time_s)
        self._restart(replace(now, motion=motion, pull=None if opens else now.pull))
        if now.obj is not None and to_mm < now.obj.size_mm:
            self._hold = self._node
