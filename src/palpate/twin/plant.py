"""The noise-free physics of a grasp, advanced in nodes with exact integration in between.

Nodes are close together during motion and increasingly far apart during a hold. Between two nodes,
the elastic force and the sheet's target are linear in time, and all relaxing states (object, creep,
spikes) are integrated exactly. A reading therefore does not depend on the times of other readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.friction import AT_REST, N_PER_G, Pull, Slide
from palpate.twin.mechanics import HandCompliance, Motion, RelaxingForce, pixel_fractions
from palpate.twin.objects import TwinObject
from palpate.twin.placement import PixelGrid, Placement, Placements
from palpate.twin.ranges import Ranges
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import Environment, Sheet

#: Friction of the supporting surface before the object is lifted; the first finger overcomes it.
TABLE_FRICTION = 0.4
#: Margin before the earliest possible contact in which nodes must be close together, mm.
_CONTACT_MARGIN_MM = 1.0
#: Node spacing while the object is pulled, and while the pull rises or it slides, seconds.
_PULLED_S, _SLIDING_S = 0.02, 0.005
#: Node spacing: minimum and maximum, seconds; travel of the fingers between nodes, mm; fraction of
#: the time since the last motion.
_SHORTEST_S, _LONGEST_S, _TRAVEL_MM, _GROWTH = 0.005, 0.5, 0.1, 0.1


@dataclass(frozen=True, slots=True)
class PlantState:
    """The complete state of the simulation."""

    time_s: float
    motion: Motion
    obj: TwinObject | None
    placed: int
    contacts: int
    closure_mm: float
    squeeze: RelaxingForce
    #: State of the sheet, computed on first use because polling of the force does not need it.
    sheet: Callable[[], SheetState]
    peak_force_n: float
    ruptured: bool
    finger_mm: float
    pull: Pull | None = None
    slide: Slide = AT_REST

    @property
    def force_n(self) -> float:
        """Grip force."""
        return self.squeeze.force_n

    @property
    def pixels(self) -> SheetState:
        """State of the sheet."""
        return self.sheet()


class Plant:
    """Deterministic physics of object, gripper and sheet for a seed, without noise.

    `ranges`: ranges of the variation between grasps.
    `seed`: seed of the variation.
    `environment`: climate and earlier use.
    `lock_force_n`: force at which the servo locks.
    `backlash_mm`: travel of the servo on reversal before a finger follows.
    `has_partial_slip`: whether the contact shifts before it slides as a whole.
    """

    def __init__(
        self,
        *,
        sheet: Sheet,
        compliance: HandCompliance,
        grid: PixelGrid,
        ranges: Ranges,
        seed: int,
        environment: Environment,
        lock_force_n: float,
        backlash_mm: float = 0.0,
        has_partial_slip: bool = True,
    ) -> None:
        self._backlash_mm = backlash_mm
        self.sheet, self.compliance, self.grid = sheet, compliance, grid
        self.environment = environment
        self._lock_force_n = lock_force_n
        #: Whether the state of the sheet is computed; otherwise it remains as it is.
        self.follows_sheet = True
        #: Whether the contact shifts before it slides (`palpate.twin.friction.shear_mm`).
        self.has_partial_slip = has_partial_slip
        self._unloaded_n = np.zeros(sheet.rest_ohm.size)
        self.placements = Placements(sheet=sheet, grid=grid, ranges=ranges, seed=seed)

    def at_rest(self, *, time_s: float, width_mm: float, obj: TwinObject | None) -> PlantState:
        """Return the state of an open gripper after a long rest."""
        motion = Motion(start_s=time_s, from_mm=width_mm, to_mm=width_mm, rate_mm_per_s=1.0)
        creep = self.placement(0, 0).creep
        pixels = SheetState.at_rest(self.sheet.rest_ohm.size, creep=creep)
        return PlantState(
            time_s=time_s,
            motion=motion,
            obj=obj,
            placed=0,
            contacts=0,
            closure_mm=self._closure_mm(obj, width_mm + self._backlash_mm, error_mm=0.0),
            finger_mm=width_mm + self._backlash_mm,
            squeeze=RelaxingForce.at_rest(obj),
            sheet=lambda: pixels,
            peak_force_n=0.0,
            ruptured=False,
        )

    def placement(self, placed: int, contacts: int) -> Placement:
        """Return the placement of the n-th object and contact."""
        return self.placements.of(placed, contacts, self.environment)

    def advance_to_next_node(self, state: PlantState) -> PlantState:
        """Return the state at the next node in time."""
        contact_s = self._contact_s(state)
        time_s = self._next_time_s(state, contact_s)
        begins = contact_s <= time_s
        contacts = state.contacts + begins
        placement = self.placement(state.placed, contacts)
        width_mm = state.motion.width_mm(time_s)
        # When the servo reverses, the fingers lag by the backlash.
        finger_mm = min(max(state.finger_mm, width_mm), width_mm + self._backlash_mm)
        closure_mm = self._closure_mm(state.obj, finger_mm, error_mm=placement.width_error_mm)
        if begins:
            closure_mm = max(closure_mm, 0.0)
        elif state.closure_mm < 0:
            closure_mm = min(closure_mm, -1e-9)
        step_s, squeeze, slide = time_s - state.time_s, RelaxingForce(), state.slide
        if state.obj is not None:
            squeeze = state.squeeze.close_to(
                state.obj,
                closure_mm,
                step_s=step_s,
                compliance=self.compliance,
                ruptured=state.ruptured,
            )
        force_n = squeeze.force_n
        if state.obj is not None and state.pull is not None:
            slide = slide.advance(
                step_s,
                pull_n=state.pull.force_n(time_s, slid_mm=slide.slid_mm),
                grip_n=force_n,
                friction=state.obj.friction,
                mass_g=state.obj.mass_g,
                pad_mm=0.5 * self.compliance.pad_deflection_mm(force_n) * self.has_partial_slip,
            )
        pixels = state.pixels
        if self.follows_sheet:
            pixels = pixels.advance(
                step_s,
                self._load_n(state, closure_mm, force_n, placement),
                travel_mm=abs(width_mm - state.motion.width_mm(state.time_s)),
                sheet=self.sheet,
                gain=placement.gain,
                creep=placement.creep,
            )
        motion = state.motion
        if force_n > self._lock_force_n and motion.to_mm < width_mm:
            motion = replace(motion, to_mm=width_mm)
        bursts = state.obj is not None and squeeze.elastic_n >= state.obj.rupture_n
        # Every field by name: `replace` takes several times as long.
        next_state = PlantState(
            time_s=time_s,
            motion=motion,
            obj=state.obj,
            placed=state.placed,
            contacts=contacts,
            closure_mm=closure_mm,
            squeeze=squeeze,
            sheet=lambda: pixels,
            peak_force_n=max(state.peak_force_n, force_n),
            ruptured=state.ruptured or bursts,
            finger_mm=finger_mm,
            pull=state.pull,
            slide=slide,
        )
        if slide.is_off_pads:
            return replace(next_state, obj=None, closure_mm=-np.inf, squeeze=RelaxingForce())
        return next_state

    def interpolate(self, state: PlantState, next_state: PlantState, time_s: float) -> PlantState:
        """Return the state at a time between a node and the next node."""
        if time_s >= next_state.time_s:
            return next_state
        fraction = (time_s - state.time_s) / (next_state.time_s - state.time_s)
        placement = self.placement(next_state.placed, next_state.contacts)
        width_mm = state.motion.width_mm(time_s)
        closure_mm = state.closure_mm + fraction * (next_state.closure_mm - state.closure_mm)
        squeeze, before_n = RelaxingForce(), state.squeeze.elastic_n
        if state.obj is not None:
            squeeze = state.squeeze.change_to(
                state.obj,
                elastic_n=before_n + fraction * (next_state.squeeze.elastic_n - before_n),
                step_s=fraction * (next_state.time_s - state.time_s),
                touching=closure_mm > 0,
            )
        sheet_at = partial(
            state.pixels.interpolate,
            next_state.pixels,
            fraction,
            step_s=time_s - state.time_s,
            travel_mm=abs(width_mm - state.motion.width_mm(state.time_s)),
            sheet=self.sheet,
            creep=placement.creep,
        )
        return PlantState(
            time_s=time_s,
            motion=state.motion,
            obj=state.obj,
            placed=state.placed,
            contacts=state.contacts,
            closure_mm=closure_mm,
            squeeze=squeeze,
            sheet=cache(sheet_at),
            peak_force_n=max(state.peak_force_n, squeeze.force_n),
            ruptured=state.ruptured,
            finger_mm=state.finger_mm,
            pull=state.pull,
            slide=state.slide,
        )

    def run(self, state: PlantState, until_s: float) -> PlantState:
        """Return the state at a later time."""
        while True:
            next_state = self.advance_to_next_node(state)
            if next_state.time_s >= until_s:
                return (
                    self.interpolate(state, next_state, until_s)
                    if until_s > state.time_s
                    else state
                )
            state = next_state

    def resistance_ohm(self, state: PlantState) -> FloatArray:
        """Return the resistance of every pixel, shape (pixels,)."""
        creep = self.placement(state.placed, state.contacts).creep
        factor = self.sheet.rest_factor(self.environment)
        return state.pixels.resistance_ohm(self.sheet, creep=creep, rest_factor=factor)

    @property
    def rest_ohm(self) -> FloatArray:
        """Resistance of every pixel without load, shape (pixels,)."""
        return self.sheet.rest_ohm * self.sheet.rest_factor(self.environment)

    def _closure_mm(self, obj: TwinObject | None, finger_mm: float, *, error_mm: float) -> float:
        return -np.inf if obj is None else obj.size_mm - finger_mm + error_mm

    def _contact_s(self, state: PlantState) -> float:
        """Return the time of first contact in the present motion; infinite without contact."""
        motion = state.motion
        if state.obj is None or state.closure_mm >= 0 or motion.to_mm > motion.from_mm:
            return np.inf
        error_mm = self.placement(state.placed, state.contacts + 1).width_error_mm
        touching_mm = state.obj.size_mm + error_mm - self._backlash_mm
        if motion.to_mm >= touching_mm:
            return np.inf
        return motion.start_s + max(motion.from_mm - touching_mm, 0.0) / motion.rate_mm_per_s

    def _next_time_s(self, state: PlantState, contact_s: float) -> float:
        if state.pull is not None:
            is_slow = state.slide.speed_mm_per_s == 0 and not state.pull.is_rising(state.time_s)
            return state.time_s + (_PULLED_S if is_slow else _SLIDING_S)
        still_s = state.time_s - state.motion.end_s
        spacing_s = _GROWTH * still_s if still_s >= 0 else _TRAVEL_MM / state.motion.rate_mm_per_s
        step_s = min(max(spacing_s, self._time_until_load_s(state), _SHORTEST_S), _LONGEST_S)
        if still_s >= 0:
            return state.time_s + step_s
        nearest = min(state.time_s + step_s, state.motion.end_s)
        return contact_s if state.time_s < contact_s < nearest else nearest

    def _time_until_load_s(self, state: PlantState) -> float:
        """Return how long the pads stay unloaded; any step within this time is exact."""
        if state.closure_mm >= 0 or state.pixels.target.any():
            return 0.0
        motion = state.motion
        if state.obj is None or motion.to_mm >= motion.width_mm(state.time_s):
            return np.inf
        lead_mm = self.placement(state.placed, state.contacts).lead_mm
        return (-state.closure_mm - lead_mm - _CONTACT_MARGIN_MM) / motion.rate_mm_per_s

    def _load_n(
        self, state: PlantState, closure_mm: float, force_n: float, placement: Placement
    ) -> FloatArray:
        """Return the load of every pixel."""
        pushed_n = self._push_force_n(state, closure_mm, placement)
        if state.obj is None or max(force_n, pushed_n) <= 0:
            return self._unloaded_n
        along_mm, across_mm = placement.off_centre_mm
        fraction = pixel_fractions(
            state.obj,
            closure_mm - self.compliance.deflection_mm(force_n),
            grid=self.grid,
            off_centre_mm=(along_mm + state.slide.shift_mm, across_mm),
        )
        if force_n <= 0:
            return np.where(self.grid.finger == placement.first_finger, pushed_n * fraction, 0.0)
        return force_n * fraction

    def _push_force_n(self, state: PlantState, closure_mm: float, placement: Placement) -> float:
        """Return the force of the first finger while it pushes the object to the middle."""
        if state.obj is None or state.pull is not None or not -placement.lead_mm < closure_mm <= 0:
            return 0.0
        return TABLE_FRICTION * N_PER_G * state.obj.mass_g
