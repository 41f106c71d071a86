"""The Velostat sheet: resistance of a pixel under a load history.

A pixel's excess conductance x = G/G0 - 1 follows a static law of its load, a saturating power law
above a threshold. Hysteresis delays the sheet until the load has fallen by a ratio. Creep is linear
in a coordinate v(x), so responses to load steps superpose. It is a sum of exponential states, which
allows exact integration:

    v(t) = (1 - sum_k w_k (1 - exp(-20 s / tau_k))) V(t) + sum_k w_k z_k(t),   tau_k z_k' = V - z_k

V is normalised to the value 20 s after a single step of load.

Three families differ in the weights w, the time constants and the coordinate:

- `two-mode`: one dominant mode near 2 s, slow creep and slight log-time creep; linear in the
  relative change, x / (1 + x). Only this family matches both rows of the paper's Table 1.
- `slow-power`: a power law of time, (1 + t/t0) ** -beta, linear in log conductance.
- `hetero`: a few modes with random time constants and weights, linear in log conductance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import gamma

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.twin.ranges import Ranges, draw_log_uniform, draw_uniform, ranges_of

#: Time after a single load step at which the static law holds, seconds (the paper's horizon).
SETTLED_S = 20.0
#: Excess conductance above which the coordinate of the relative change continues as a logarithm,
#: because linear creep in the relative change would make the resistance negative.
_LOG_START = 6.0
#: Pixel pitch to which the force ranges apply, mm.
USUAL_PITCH_MM = 10.0
#: Climate of the paper's room (section 2.1); the humidity is our assumption.
ROOM_C, ROOM_HUMIDITY_PERCENT = 21.9, 45.0
#: exp(-s ** 1.12) as a sum of exponentials in s, to within 0.003.
_COMPRESSED = ((1.21610, 0.84748), (-0.21610, 0.30244))


@dataclass(frozen=True, slots=True)
class Creep:
    """Creep states of one grasp: time constants and weights, both of shape (states,)."""

    tau_s: FloatArray
    weight: FloatArray

    @property
    def instant_fraction(self) -> float:
        """Fraction of the static value reached instantly."""
        return float(1.0 + self.weight @ np.expm1(-SETTLED_S / self.tau_s))


def two_mode_creep(rng: np.random.Generator, scale: float) -> Creep:
    """Draw creep fitted to Table 1: two exponential modes and 0.0103 ln(1 + t/3.2)."""
    middle = 0.131 * np.exp(0.28 * rng.standard_normal())
    middle_s = 1.96 * np.exp(0.37 * rng.standard_normal())
    slow = 0.068 + 0.026 * rng.standard_normal()
    log_rate = 0.0103 + 0.0089 * rng.standard_normal()
    log_s = 1.6 * 4.0 ** np.arange(6)
    # ln(1 + t/t0) is the integral of (1 - exp(-t/tau)) exp(-t0/tau) over ln tau.
    log_weight = np.log(4.0) * log_rate * np.exp(-3.2 / log_s)
    parts, times = zip(*_COMPRESSED, strict=True)
    tau_s = np.concatenate([middle_s * np.array(times), [17.2], log_s])
    weight = np.concatenate([middle * np.array(parts), [slow], log_weight])
    return Creep(tau_s, scale * weight)


def slow_power_creep(fraction: float, *, exponent: float, start_s: float) -> Creep:
    """Return creep with the remainder (1 + t/start_s) ** -exponent, as a sum of exponentials."""
    ratio = 3.0
    s = ratio ** np.arange(-9.0, 3.0)
    weight = fraction * np.log(ratio) / gamma(exponent) * s**exponent * np.exp(-s)
    return Creep(start_s / s, weight)


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Creep of a sheet: random draw for each grasp, and the coordinate of linear creep."""

    name: str
    #: Whether creep is linear in the relative change instead of log conductance.
    relative: bool
    draw: Callable[[np.random.Generator], Creep]

    def coordinate(self, excess: FloatArray) -> FloatArray:
        """Return the coordinate v of an excess conductance."""
        if not self.relative:
            return np.log1p(excess)
        low = np.minimum(excess, _LOG_START)
        log_ratio = np.log(np.maximum(excess, _LOG_START) / _LOG_START)
        return low / (1.0 + low) + _LOG_START / (1.0 + _LOG_START) ** 2 * log_ratio

    def excess_conductance(self, coordinate: FloatArray) -> FloatArray:
        """Return the excess conductance of a coordinate: the inverse of `coordinate`."""
        if not self.relative:
            return np.expm1(coordinate)
        bend = _LOG_START / (1.0 + _LOG_START)
        low = np.minimum(coordinate, bend)
        log_ratio = np.maximum(coordinate - bend, 0.0) * (1.0 + _LOG_START) ** 2 / _LOG_START
        return low / (1.0 - low) * np.exp(log_ratio)


def _draw_two_mode(rng: np.random.Generator, ranges: Ranges) -> Family:
    scale = draw_uniform(rng, ranges.two_mode_scale)
    return Family(name="two-mode", relative=True, draw=lambda grasp: two_mode_creep(grasp, scale))


def _draw_slow_power(rng: np.random.Generator, ranges: Ranges) -> Family:
    fraction = draw_uniform(rng, ranges.slow_power_fraction)
    exponent = draw_uniform(rng, ranges.slow_power_exponent)
    start_s = draw_log_uniform(rng, ranges.slow_power_start_s_log)
    sd = ranges.creep_place_log_sd

    def draw(grasp: np.random.Generator) -> Creep:
        jitter = np.exp(sd * grasp.standard_normal(2))
        return slow_power_creep(
            fraction * jitter[0], exponent=exponent, start_s=start_s * jitter[1]
        )

    return Family(name="slow-power", relative=False, draw=draw)


def _draw_hetero(rng: np.random.Generator, ranges: Ranges) -> Family:
    modes = int(rng.integers(3, 6))
    tau_s = np.sort([draw_log_uniform(rng, ranges.hetero_time_s_log) for _ in range(modes)])
    weight = rng.dirichlet(np.ones(modes)) * draw_uniform(rng, ranges.hetero_fraction)
    sd = ranges.creep_place_log_sd

    def draw(grasp: np.random.Generator) -> Creep:
        jitter = np.exp(sd * grasp.standard_normal((2, modes)))
        return Creep(tau_s * jitter[0], weight * jitter[1])

    return Family(name="hetero", relative=False, draw=draw)


#: Name -> draw of a family at a level.
FAMILIES: dict[str, Callable[[np.random.Generator, Ranges], Family]] = {
    "two-mode": _draw_two_mode,
    "slow-power": _draw_slow_power,
    "hetero": _draw_hetero,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Environment and wear of a sheet; by default a new sheet in the paper's room."""

    #: Climate.
    temperature_c: float = ROOM_C
    humidity_percent: float = ROOM_HUMIDITY_PERCENT
    #: Number of earlier contacts.
    cycles: int = 0
    #: Whether `cycles` includes the world's own contacts, counted by the caller. Otherwise the
    #: world adds its own contacts to the wear of the gain.
    cycles_are_all: bool = False
    #: Pressure between the layers minus the pressure outside, kPa.
    suction_kpa: float = 0.0

    @property
    def temperature_rise_k(self) -> float:
        """Temperature above that of the paper's room, kelvin."""
        return self.temperature_c - ROOM_C

    @property
    def humidity_rise_percent(self) -> float:
        """Relative humidity above the assumption for the paper's room, percentage points."""
        return self.humidity_percent - ROOM_HUMIDITY_PERCENT


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """One sheet of pixels; arrays have shape (pixels,). Load is the pixel's force in newtons."""

    family: Family
    rest_ohm: FloatArray
    gain: FloatArray
    unit_force_n: float
    exponent: float
    threshold_n: float
    saturation: float
    hysteresis: float
    spike_decay_s: float
    spike_per_mm: float
    spike_per_target: float
    white_noise: float
    slow_noise: float
    rest_per_kelvin: float
    rest_per_humidity_percent: float
    gain_per_kelvin: float
    gain_per_humidity_percent: float
    break_in: float
    break_in_cycles: float
    rest_break_in: float
    rest_per_1000_cycles: float
    gain_per_1000_cycles: float
    lift_fraction: float
    lift_kpa: float

    def static_excess(self, load_n: FloatArray, *, gain: FloatArray) -> FloatArray:
        """Return the static excess conductance under a load, without history."""
        pressed = np.maximum(load_n - self.threshold_n, 0.0) / self.unit_force_n
        x = gain * pressed**self.exponent
        return x / (1.0 + x / self.saturation)

    def follow(self, followed_n: FloatArray, load_n: FloatArray) -> FloatArray:
        """Return the effective load: immediate when rising, delayed by a ratio when falling."""
        return np.minimum(np.maximum(followed_n, load_n), load_n * (1.0 + self.hysteresis))

    def rest_factor(self, environment: Environment) -> float:
        """Return the rest resistance relative to that of a new sheet in the paper's room.

        Suction separates the layers and removes up to a fraction of the conductance.
        """
        climate = (
            self.rest_per_kelvin * environment.temperature_rise_k
            + self.rest_per_humidity_percent * environment.humidity_rise_percent
        )
        broken_in = -np.expm1(-environment.cycles / self.break_in_cycles)
        wear = self.rest_break_in * broken_in
        wear += self.rest_per_1000_cycles * environment.cycles / 1000.0
        lifted = -self.lift_fraction * np.expm1(-environment.suction_kpa / self.lift_kpa)
        return float(np.exp(climate + wear) / (1.0 - lifted))

    def gain_factor(self, environment: Environment) -> float:
        """Return the gain relative to that of a broken-in sheet in the paper's room."""
        climate = (
            self.gain_per_kelvin * environment.temperature_rise_k
            + self.gain_per_humidity_percent * environment.humidity_rise_percent
        )
        wear = self.gain_per_1000_cycles * environment.cycles / 1000.0
        fresh = self.break_in * np.exp(-environment.cycles / self.break_in_cycles)
        return float(np.exp(climate + wear) * (1.0 + fresh))


def draw_sheet(
    rng: np.random.Generator, *, layout: ArrayLayout, level: str, family: str | None = None
) -> Sheet:
    """Draw a sheet.

    `level` ("lab" or "field"): level of the ranges (`palpate.twin.ranges`).
    `family`: name in `FAMILIES`; drawn by default.
    """
    ranges = ranges_of(level)
    drawn = str(rng.choice(ranges.families))
    name = family or drawn
    if name not in FAMILIES:
        raise ValueError(f"no relaxation family {name!r}; available: {', '.join(FAMILIES)}")
    pixels = layout.pixels
    # A separate stream preserves the other draws of a seed.
    aging = rng.spawn(1)[0]
    # The sheet responds to pressure, so forces scale with the area of a pixel.
    area = (layout.pitch_mm / USUAL_PITCH_MM) ** 2
    rest_ohm = draw_log_uniform(rng, ranges.rest_ohm_log)
    return Sheet(
        family=FAMILIES[name](np.random.default_rng(rng.integers(2**63)), ranges),
        rest_ohm=rest_ohm * np.exp(ranges.rest_pixel_log_sd * rng.standard_normal(pixels)),
        gain=np.exp(ranges.sheet_pixel_log_sd * rng.standard_normal(pixels)),
        unit_force_n=area * draw_log_uniform(rng, ranges.unit_force_n_log),
        exponent=draw_uniform(rng, ranges.exponent),
        threshold_n=area * draw_uniform(rng, ranges.threshold_n),
        saturation=draw_log_uniform(rng, ranges.saturation_log),
        hysteresis=draw_uniform(rng, ranges.hysteresis),
        spike_decay_s=draw_uniform(rng, ranges.spike_decay_s),
        spike_per_mm=draw_uniform(rng, ranges.spike_per_mm),
        spike_per_target=draw_uniform(rng, ranges.spike_per_target),
        white_noise=draw_uniform(rng, ranges.white_noise),
        slow_noise=draw_uniform(rng, ranges.slow_noise),
        rest_per_kelvin=draw_uniform(rng, ranges.rest_per_kelvin),
        rest_per_humidity_percent=draw_uniform(rng, ranges.rest_per_humidity_percent),
        gain_per_kelvin=draw_uniform(rng, ranges.gain_per_kelvin),
        break_in=draw_uniform(rng, ranges.break_in),
        break_in_cycles=draw_log_uniform(rng, ranges.break_in_cycles_log),
        gain_per_humidity_percent=draw_uniform(aging, ranges.gain_per_humidity_percent),
        rest_break_in=draw_uniform(aging, ranges.rest_break_in),
        rest_per_1000_cycles=draw_uniform(aging, ranges.rest_per_1000_cycles),
        gain_per_1000_cycles=draw_uniform(aging, ranges.gain_per_1000_cycles),
        lift_fraction=draw_uniform(aging, ranges.lift_fraction),
        lift_kpa=draw_log_uniform(aging, ranges.lift_kpa_log),
    )
