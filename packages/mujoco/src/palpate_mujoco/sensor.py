"""A simulated sensor on the pads of any MuJoCo model, from contacts to counts."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.errors import InputError
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout
from palpate.twin.placement import PixelGrid, Placement, Placements
from palpate.twin.ranges import ranges_of
from palpate.twin.readout import Readout
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import Environment, draw_sheet
from palpate_mujoco.pads import GridLoads, Pad, PadLoads, TouchGrid

#: Radius of a contact's spread relative to the pitch of the pixels, as on the twin.
SPREAD_RATIO = 0.8
#: Time without contact after which a contact is at another place of the sheet, seconds.
_FREE_S = 0.2


class PadSensor:
    """The pixels on the pads of a model, with their sheet and readout.

    `palpate.twin.devices.TwinArray(sensor)` is the array; reading a frame steps the model. Programs
    that step the model themselves call `update` after each step, and `counts` for a frame. Contacts
    are evaluated periodically, and loads are linear in between.

    Parameters
    ----------
    model, data : MjModel, MjData
        Any model with the pads' geoms, and its state.
    pads : sequence of Pad, or of TouchGrid
        One per finger of the layout.
    layout : ArrayLayout
        Pixels and readout.
    seed : int
        Seed of the variation between contacts, and of noise.
    sheet_seed : int, optional
        Seed of the sheet; `seed` by default.
    level : {"lab", "field"}
        Scatter of the sheets (`palpate.twin.ranges`).
    clock : ManualClock, optional
        Clock of the array; by default a clock that starts at the model's time.
    frame_rate_hz : float
        Scan rate of the array.
    oversampling : int
        Conversions summed per pixel.
    every_s : float, optional
        Period of the evaluation of contacts; once per frame by default.

    Raises
    ------
    InputError
        If the model lacks a pad, or the wiring of the layout is not simulated.

    Examples
    --------
    A ball of 1 kg on a pad that faces up:

    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <geom name="pad" type="box" size="0.01 0.01 0.001"/>
    ...   <body pos="0 0 0.026"><freejoint/><geom size="0.025" mass="1"/></body>
    ... </worldbody></mujoco>''')
    >>> palm = ArrayLayout(name="palm", rows=2, cols=2, finger_of_row=(0, 0))
    >>> up = Pad(geom="pad", along=(1, 0, 0), across=(0, 1, 0))
    >>> sensor = PadSensor(model, mujoco.MjData(model), pads=[up], layout=palm, seed=1)
    >>> sensor.step_to(1.0)
    >>> sensor.load_n.round(2).tolist()
    [[2.45, 2.45], [2.45, 2.45]]
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *,
        pads: Sequence[Pad | TouchGrid],
        layout: ArrayLayout = RIGID_LAYOUT,
        seed: int,
        sheet_seed: int | None = None,
        level: str = "lab",
        clock: ManualClock | None = None,
        frame_rate_hz: float = 15.0,
        oversampling: int = 1,
        every_s: float | None = None,
    ) -> None:
        if layout.idle_lines == "held" or layout.line_ohm > 0:
            raise InputError(
                f"layout {layout.name}: the simulated readout has neither held lines nor line_ohm; "
                "use idle_lines 'isolated' or 'floating', and line_ohm 0"
            )
        self._every_s = 1.0 / frame_rate_hz if every_s is None else every_s
        self.layout, self.frame_rate_hz, self.oversampling = layout, frame_rate_hz, oversampling
        self.clock = ManualClock(data.time) if clock is None else clock
        #: Called with the new time before the world advances, such as by a scanning array.
        self.watchers: list[Callable[[float], None]] = []
        #: Radius of a contact's spread, mm.
        self.reach_mm = SPREAD_RATIO * layout.pitch_mm
        self._pads = tuple(pads)
        self._ranges = ranges_of(level)
        sheet_seed = seed if sheet_seed is None else sheet_seed
        self.sheet = draw_sheet(np.random.default_rng([sheet_seed, 0]), layout=layout, level=level)
        grid = PixelGrid.from_layout(layout)
        self._on_finger = 1.0 * (grid.finger == np.arange(layout.fingers)[:, None])
        self._placements = Placements(sheet=self.sheet, grid=grid, ranges=self._ranges, seed=seed)
        self._environment = Environment()
        self._rest_factor = self.sheet.rest_factor(self._environment)
        self._placed = self._touches = 0
        self._readout = Readout(
            sheet=self.sheet,
            layout=layout,
            oversampling=oversampling,
            adc_noise_counts=self._ranges.adc_noise_counts,
            seed=seed,
            start_s=self.clock.now_s(),
        )
        self.attach(model, data)
        self._state = SheetState.at_rest(layout.pixels, creep=self.placement.creep)
        self._free_s = np.inf

    @property
    def placement(self) -> Placement:
        """Random variation of the current contact."""
        return self._placements.of(self._placed, self._touches, environment=self._environment)

    @property
    def load_n(self) -> FloatArray:
        """Load of every pixel at the last update, shape (rows, cols)."""
        return self._load_n.reshape(self.layout.rows, self.layout.cols)

    @property
    def finger_n(self) -> FloatArray:
        """Force on each finger's pad, shape (fingers,)."""
        finger_n: FloatArray = self._on_finger @ self._load_n
        return finger_n

    def attach(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Continue with the same pads in another model or state."""
        self.model, self.data = model, data
        grids = [pad for pad in self._pads if isinstance(pad, TouchGrid)]
        pads = [pad for pad in self._pads if isinstance(pad, Pad)]
        self._loads: PadLoads | GridLoads = (
            GridLoads(model, grids=grids, layout=self.layout)
            if grids
            else PadLoads(model, pads=pads, layout=self.layout)
        )
        self._load_n = np.zeros(self.layout.pixels)
        self._updated_s = data.time

    def change_placement(self) -> None:
        """Draw another position on the pads, for a new object."""
        self._placed += 1

    def copy(self, data: mujoco.MjData) -> PadSensor:
        """Return an independent sensor that continues from a copy of the state."""
        other = copy.copy(self)
        other.watchers, other.data = [], data
        return other

    def step_to(self, time_s: float) -> None:
        """Step the model to a time, updating the sheet periodically."""
        while (left_s := time_s - self.data.time) > 0.5 * self.model.opt.timestep:
            steps = max(round(min(left_s, self._every_s) / self.model.opt.timestep), 1)
            mujoco.mj_step(self.model, self.data, steps)
            self.update_now()

    def update(self) -> None:
        """Update the sheet if its period has elapsed."""
        if self.data.time - self._updated_s >= self._every_s - 0.5 * self.model.opt.timestep:
            self.update_now()

    def update_now(self, *, travel_mm: float = 0.0) -> None:
        """Update the sheet with the contacts at the model's time.

        `travel_mm` is the travel of the fingers since the last call, which causes spikes.

        Raises
        ------
        ValueError
            If the model's time decreased, because the sheet's history can't be undone.
        """
        step_s = self.data.time - self._updated_s
        if step_s < 0:
            raise ValueError(
                f"the model's time decreased from {self._updated_s:g} to {self.data.time:g} s; "
                "create a new sensor after a reset (MuJoCo also resets a diverged simulation)"
            )
        if step_s == 0:
            return
        self._updated_s = self.data.time
        self._load_n = self._loads.load_n(self.data, reach_mm=self.reach_mm)
        loaded = bool(np.count_nonzero(self._load_n))
        self._touches += loaded and self._free_s > _FREE_S
        self._free_s = 0.0 if loaded else self._free_s + step_s
        placement = self.placement
        self._state = self._state.advance(
            step_s,
            self._load_n,
            travel_mm=travel_mm,
            sheet=self.sheet,
            gain=placement.gain,
            creep=placement.creep,
        )

    def resistance_ohm(self) -> FloatArray:
        """Return the resistance of each pixel without noise, shape (rows, cols)."""
        ohm = self._state.resistance_ohm(
            self.sheet, creep=self.placement.creep, rest_factor=self._rest_factor
        )
        return ohm.reshape(self.layout.rows, self.layout.cols)

    def change_percent(self) -> FloatArray:
        """Return the change of each pixel relative to rest without noise, shape (rows, cols)."""
        rest_ohm = (self.sheet.rest_ohm * self._rest_factor).reshape(self.load_n.shape)
        return 100.0 * (self.resistance_ohm() / rest_ohm - 1.0)

    def voltage_v(self) -> FloatArray:
        """Return the voltages at the converter's input, shape (rows, cols)."""
        return self._readout.sample_volts(self.resistance_ohm(), time_s=self.data.time)

    def counts(self) -> NDArray[np.int32]:
        """Update the sheet and return one scan at the model's time, shape (rows, cols)."""
        self.update_now()
        return self._readout.sample_counts(self.resistance_ohm(), time_s=self.data.time)

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Step the model to a time and return one scan, shape (rows, cols)."""
        self.step_to(time_s)
        return self.counts()
