"""One hybrid grasp: calibrate the recorded sheet, grasp the recorded fruit, compare."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.estimate.damage import DamageModel
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.measurement import Measurement
from palpate.grasp.calibrating import Bench, measure_block, measure_force, measure_rest
from palpate.grasp.planning import DWELL_S, HORIZON_S, pairs_at, plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, PressureArray
from palpate.sensor.calibration import Calibration
from palpate.sensor.reference_resistor import fit_reference
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.firmware import open_firmware_array
from palpate_studies.hybrid_world import ADC_NOISE_COUNTS, Curve, RecordedSheet, RecordedWorld
from palpate_studies.stoppable import uninterrupted

#: What the load cell is faced with, and the block: springs, newtons per millimetre. The hand's own
#: give is in the recorded curves; on the block it gives way by a tenth of a millimetre per newton.
_FACES_N_PER_MM, _BLOCK_N_PER_MM, _BLOCK_MM = (3.0, 5.0, 8.0), 10.0, 40.0
_HOLDS_N = ((0.4, 3.0), (0.8, 6.0), (0.3, 2.0), (1.5, 9.0), (0.6, 4.0))
#: The fruit's extent, and how far the fingers are open beyond it at the start, mm.
_SIZES_MM, _GAP_MM = (30.0, 65.0), 4.0
#: Mass, grams, and friction of a soft pad on fruit: plausible, not measured.
MASS_G, FRICTION = {"banana": 130.0, "kiwi": 90.0, "mango": 250.0}, 0.6
_DEFAULT_MASS_G, _GRAVITY = 150.0, 9.81
#: The paper's way: contact by the threshold, then a fixed closing further (section 4.1).
FIXED_MM = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hybrid:
    """One grasp of a recorded fruit.

    Attributes
    ----------
    name, fruit : str
        The recording.
    way : str
        How it was grasped.
    outcome : str
        As the grasp reported it.
    rupture_n, lift_n : float
        Force at which the recording ruptures, and that its weight asks for.
    force_n, peak_n : float
        Force of the final grip, and the largest ever.
    said : Measurement or None
        The force that the grasp reported.
    decision_s : float or None
        From contact to the answer.
    """

    name: str
    fruit: str
    way: str
    outcome: str
    rupture_n: float
    lift_n: float
    force_n: float
    peak_n: float
    said: Measurement | None
    decision_s: float | None

    @property
    def damaged(self) -> bool:
        """Whether it ruptured."""
        return self.peak_n >= self.rupture_n

    @property
    def dropped(self) -> bool:
        """Whether it was called held with too little force to lift it."""
        return self.outcome == "held" and self.force_n < self.lift_n


def lift_force_n(fruit: str) -> float:
    """Return the grip force of two fingers that carries the fruit, newtons."""
    return 1e-3 * MASS_G.get(fruit, _DEFAULT_MASS_G) * _GRAVITY / (2.0 * FRICTION)


def layout_for(sheet: RecordedSheet) -> ArrayLayout:
    """Return the paper's array with the resistor that `palpate doctor` would advise."""
    low_ohm = sheet.rest_ohm * float(np.exp(-sheet.log_fall[-1]))
    divider = RIGID_LAYOUT.divider
    fit = fit_reference(low_ohm=low_ohm, high_ohm=sheet.rest_ohm, divider=divider)
    return replace(RIGID_LAYOUT, divider=replace(divider, reference_ohm=fit.recommended_ohm))


def calibrated(sheet: RecordedSheet, *, seed: int) -> Calibration:
    """Calibrate a sheet by a user's steps, read without the firmware."""
    layout = layout_for(sheet)
    world = RecordedWorld(sheet, layout=layout, seed=seed)
    array = TwinArray(world)
    bench = Bench(
        array=array,
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=_BLOCK_MM + 1.0,
        skip_until=array.skip_until,
    )
    rest = measure_rest(bench)
    force = measure_force(
        bench,
        holds_n=_HOLDS_N,
        reseat=lambda run: world.place(
            _spring(_FACES_N_PER_MM[run % len(_FACES_N_PER_MM)]), size_mm=_BLOCK_MM
        ),
        dwell_s=DWELL_S,
        horizon_s=HORIZON_S,
    )
    world.place(_spring(_BLOCK_N_PER_MM), size_mm=_BLOCK_MM)
    block = measure_block(bench, block_mm=_BLOCK_MM, up_to_n=9.0, repeats=2, dwell_s=DWELL_S)
    excess, force_n = pairs_at(force, since_move_s=HORIZON_S)
    return Calibration(
        sensor_id=f"recorded-{seed}",
        origin="simulated",
        layout=layout,
        rest=rest,
        force=force,
        block=block,
        force_law=PowerForceLaw.fit(excess, force_n=force_n).as_dict(),
    )


def _spring(n_per_mm: float) -> Curve:
    closing = np.array([0.0, 100.0 / n_per_mm])
    return Curve(name="spring", fruit="", closing_mm=closing, force_n=closing * n_per_mm)


def grasped(
    curve: Curve,
    sheet: RecordedSheet,
    calibration: Calibration,
    *,
    seed: int,
    damage: DamageModel | None,
    way: str,
    firmware: bool,
    kind: str = "",
) -> Hybrid:
    """Grasp a fruit with only its weight known, and compare with the recording.

    The learned limit may be given its kind.
    """
    world = RecordedWorld(sheet, layout=calibration.layout, seed=seed)
    size_mm = float(np.random.default_rng([seed, 2]).uniform(*_SIZES_MM))
    world.drive(size_mm + _GAP_MM, rate=60.0)
    world.clock.sleep_s(2.0)
    world.place(curve, size_mm=size_mm)
    gripper, lift_n = TwinGripper(world), lift_force_n(curve.fruit)
    plan = plan_grasp(calibration, gripper=gripper, lift_force_n=lift_n, damage=damage, kind=kind)
    array = _array(world, firmware=firmware)
    try:
        result = uninterrupted(run_grasp(plan, array=array, gripper=gripper, clock=world.clock))
    finally:
        array.close()
    # The recordings have no relaxation of the fruit: the largest force is that of the final grip.
    return Hybrid(
        name=curve.name,
        fruit=curve.fruit,
        way=way,
        outcome=str(result.outcome),
        rupture_n=curve.rupture_n,
        lift_n=lift_n,
        force_n=world.peak_force_n,
        peak_n=world.peak_force_n,
        said=result.force_n,
        decision_s=result.decision_time_s,
    )


def _array(world: RecordedWorld, *, firmware: bool) -> PressureArray:
    if not firmware:
        return TwinArray(world)
    divider = world.layout.divider
    count_mv = 1e3 * divider.supply_v / divider.full_scale
    return open_firmware_array(
        world, noise_mv=count_mv * ADC_NOISE_COUNTS, rate_hz=world.frame_rate_hz
    )


def fixed_closing(curve: Curve, *, contact_n: float) -> Hybrid:
    """Close `FIXED_MM` further than where the sheet fell by 10 %, in whole steps of 1 mm."""
    contact_mm = float(np.interp(contact_n, curve.force_n, curve.closing_mm))
    # Somewhere in the step of 1 mm that shows it: at its middle on average.
    force_n = float(np.interp(contact_mm + 0.5 + FIXED_MM, curve.closing_mm, curve.force_n))
    return Hybrid(
        name=curve.name,
        fruit=curve.fruit,
        way="threshold and 3 mm",
        outcome="held",
        rupture_n=curve.rupture_n,
        lift_n=lift_force_n(curve.fruit),
        force_n=force_n,
        peak_n=force_n,
        said=None,
        decision_s=None,
    )
