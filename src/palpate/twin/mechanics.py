"""Force and pixel loads from closure: object, pads, fingers and servo in series.

A relaxing object and a compliant gripper share the closure. A fraction s_k of every change of the
object's elastic force E(x) decays with the time constant tau_k. Over one step in which E is linear
in time, the force is a linear function of the new E, F = retained E + carried. The balance with the
gripper is then one equation in the deformation x. Consequently, an object between stiff fingers
relaxes, and an object between fingers of constant force creeps.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray

from palpate.twin.objects import TwinObject
from palpate.twin.placement import PixelGrid

#: Fraction of the slope that remains beyond yield, and of the force that remains after rupture.
_YIELDED_SLOPE_FRACTION = 0.3
_RUPTURED_FORCE_FRACTION = 0.35


@dataclass(frozen=True, slots=True, kw_only=True)
class HandCompliance:
    """Compliance of the gripper: fingers, servo (a spring), and pads until they bottom out."""

    #: Fingers and servo, both sides together.
    finger_mm_per_n: float
    #: The pads deflect by pad_travel_mm * (1 - exp(-F / pad_force_n)).
    pad_travel_mm: float
    pad_force_n: float

    def deflection_mm(self, force_n: float) -> float:
        """Return the gripper's deflection under a force."""
        return self.finger_mm_per_n * force_n + self.pad_deflection_mm(force_n)

    def pad_deflection_mm(self, force_n: float) -> float:
        """Return the deflection of both pads together under a force."""
        return -self.pad_travel_mm * math.expm1(-force_n / self.pad_force_n)

    def slope_mm_per_n(self, force_n: float) -> float:
        """Return the derivative of `deflection_mm`."""
        pad = self.pad_travel_mm / self.pad_force_n * math.exp(-force_n / self.pad_force_n)
        return self.finger_mm_per_n + pad


def object_force_n(
    obj: TwinObject, deformation_mm: float, *, ruptured: bool
) -> tuple[float, float]:
    """Return an object's elastic force and its slope (N/mm) at a deformation."""
    return _force_law(obj, ruptured=ruptured)(deformation_mm)


def _force_law(obj: TwinObject, *, ruptured: bool) -> Callable[[float], tuple[float, float]]:
    """Return an object's force law: a function that maps deformation to force and slope."""
    scale = _RUPTURED_FORCE_FRACTION if ruptured else 1.0
    yield_n, undamaged = obj.yield_n, _elastic_law(obj)

    def law(deformation_mm: float) -> tuple[float, float]:
        force_n, slope = undamaged(max(deformation_mm, 0.0))
        force_n, slope = scale * force_n, scale * slope
        if force_n <= yield_n:
            return force_n, slope
        yield_mm = deformation_before_damage_mm(obj, yield_n / scale)
        flatter = _YIELDED_SLOPE_FRACTION * scale * undamaged(yield_mm)[1]
        return yield_n + flatter * (deformation_mm - yield_mm), flatter

    return law


def _elastic_law(obj: TwinObject) -> Callable[[float], tuple[float, float]]:
    """Return an undamaged object's force law; see `_force_law`."""
    if obj.curve is not None:
        return partial(_interpolate_curve, obj.curve)
    at_1mm_n, exponent = obj.force_at_1mm_n, obj.exponent

    def power(deformation_mm: float) -> tuple[float, float]:
        if deformation_mm == 0.0:
            return 0.0, at_1mm_n if exponent == 1.0 else 0.0
        force_n = at_1mm_n * deformation_mm**exponent
        return force_n, exponent * force_n / deformation_mm

    return power


def _interpolate_curve(
    curve: tuple[tuple[float, float], ...], deformation_mm: float
) -> tuple[float, float]:
    (x0, f0), (x1, f1) = _find_segment(curve, deformation_mm, by=0)
    slope = (f1 - f0) / (x1 - x0)
    return f0 + slope * (deformation_mm - x0), slope


def deformation_before_damage_mm(obj: TwinObject, force_n: float) -> float:
    """Return the deformation of an undamaged object under a force."""
    if obj.curve is not None:
        (x0, f0), (x1, f1) = _find_segment(obj.curve, force_n, by=1)
        return x0 + (force_n - f0) * (x1 - x0) / (f1 - f0)
    return float((force_n / obj.force_at_1mm_n) ** (1.0 / obj.exponent))


def _find_segment(
    curve: tuple[tuple[float, float], ...], value: float, *, by: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the two points of a curve around a deformation (`by=0`) or force (`by=1`)."""
    after = bisect_left(curve, value, lo=1, hi=len(curve) - 1, key=lambda point: point[by])
    return curve[after - 1], curve[after]


def series_force_n(
    obj: TwinObject,
    closure_mm: float,
    *,
    compliance: HandCompliance,
    ruptured: bool = False,
    retained: float = 1.0,
    carried_n: float = 0.0,
) -> float:
    """Return the object's elastic force in series with the gripper at a closure.

    The force on the gripper is retained * elastic + carried_n (see the module), at least 0.
    Solves deformation + deflection(force(deformation)) = closure. The left side is monotonic and is
    solved with Newton steps inside a shrinking bracket.
    """
    if closure_mm <= 0:
        return 0.0
    low, high = 0.0, closure_mm
    deformation, law = 0.5 * closure_mm, _force_law(obj, ruptured=ruptured)
    for _ in range(60):
        elastic_n, slope = law(deformation)
        grip_n = max(retained * elastic_n + carried_n, 0.0)
        excess = deformation + compliance.deflection_mm(grip_n) - closure_mm
        if abs(excess) < 1e-10:
            return elastic_n
        low, high = (low, deformation) if excess > 0 else (deformation, high)
        grip_slope = retained * slope if grip_n > 0 else 0.0
        step = excess / (1.0 + compliance.slope_mm_per_n(grip_n) * grip_slope)
        newton = deformation - step
        deformation = newton if low < newton < high else 0.5 * (low + high)
    return law(deformation)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion of the fingers from one opening to another at a constant rate."""

    start_s: float
    from_mm: float
    to_mm: float
    rate_mm_per_s: float

    @property
    def end_s(self) -> float:
        """Arrival time of the fingers."""
        return self.start_s + abs(self.to_mm - self.from_mm) / self.rate_mm_per_s

    def width_mm(self, time_s: float) -> float:
        """Return the opening at a time."""
        length_mm = self.to_mm - self.from_mm
        travel = min(max(time_s - self.start_s, 0.0) * self.rate_mm_per_s, abs(length_mm))
        return self.from_mm + math.copysign(travel, length_mm)


def pixel_fractions(
    obj: TwinObject, deformation_mm: float, *, grid: PixelGrid, off_centre_mm: tuple[float, float]
) -> NDArray[np.float64]:
    """Return each pixel's fraction of its finger's force, shape (pixels,).

    A flat object loads the whole pad, with a slight gradient towards its position. A round object
    loads a parabolic patch whose radius grows as in Hertz contact (each side is indented by half).
    """
    if obj.faces is not None:
        return obj.faces.pixel_fractions(deformation_mm, grid=grid, off_centre_mm=off_centre_mm)
    along, across = grid.along_mm - off_centre_mm[0], grid.across_mm - off_centre_mm[1]
    if obj.flat:
        tilt = grid.along_mm * off_centre_mm[0] + grid.across_mm * off_centre_mm[1]
        weight = 1.0 + 0.3 * tilt / grid.pitch_mm**2
    else:
        radius_mm = contact_radius_mm(obj, deformation_mm, pitch_mm=grid.pitch_mm)
        weight = np.maximum(1.0 - (along**2 + across**2) / radius_mm**2, 0.0)
    total = np.bincount(grid.finger, weights=weight)
    fraction: NDArray[np.float64] = weight / np.maximum(total, 1e-12)[grid.finger]
    return fraction


def contact_radius_mm(obj: TwinObject, deformation_mm: float, *, pitch_mm: float) -> float:
    """Return the radius over which a contact's force spreads, mm: pad cover and Hertz contact.

    Each side of a round object is indented by half; the contact of a flat object does not grow.

    >>> from palpate.twin.objects import draw_object
    >>> ball = draw_object(np.random.default_rng(1), "ball-33lbs")
    >>> [round(contact_radius_mm(ball, deep_mm, pitch_mm=10.0)) for deep_mm in (0.0, 2.0)]
    [8, 13]
    """
    hertz_mm = 0.0 if obj.flat else math.sqrt(0.25 * obj.size_mm * max(deformation_mm, 0.0))
    return 0.8 * pitch_mm + hertz_mm


@dataclass(frozen=True, slots=True)
class RelaxingForce:
    """An object's elastic force, its relaxing parts, and the force that remains."""

    elastic_n: float = 0.0
    relaxing_n: tuple[float, ...] = ()
    force_n: float = 0.0

    @classmethod
    def at_rest(cls, obj: TwinObject | None) -> Self:
        """Return the state of an object before any contact."""
        return cls(relaxing_n=() if obj is None else (0.0,) * len(obj.relaxing_fractions))

    def close_to(
        self,
        obj: TwinObject,
        closure_mm: float,
        *,
        step_s: float,
        compliance: HandCompliance,
        ruptured: bool = False,
    ) -> RelaxingForce:
        """Return the state after a step to a closure; contact requires closure > 0."""
        parts = _relaxation_steps(obj, step_s)
        if closure_mm <= 0:
            return self._change(obj, parts, elastic_n=0.0, touching=False)
        fresh = sum([fraction * mean for fraction, _, mean in parts])
        carried_n = sum([n * part[1] for n, part in zip(self.relaxing_n, parts, strict=True)])
        elastic_n = series_force_n(
            obj,
            closure_mm,
            compliance=compliance,
            ruptured=ruptured,
            retained=1.0 - sum(obj.relaxing_fractions) + fresh,
            carried_n=carried_n - self.elastic_n * fresh,
        )
        return self._change(obj, parts, elastic_n=elastic_n, touching=True)

    def change_to(
        self, obj: TwinObject, *, elastic_n: float, step_s: float, touching: bool = True
    ) -> RelaxingForce:
        """Return the state after a step in which the elastic force changed linearly."""
        return self._change(
            obj, _relaxation_steps(obj, step_s), elastic_n=elastic_n, touching=touching
        )

    def _change(
        self,
        obj: TwinObject,
        parts: list[tuple[float, float, float]],
        *,
        elastic_n: float,
        touching: bool,
    ) -> RelaxingForce:
        rise_n = elastic_n - self.elastic_n
        relaxing_n = tuple(
            [
                before * decay + fraction * rise_n * mean
                for before, (fraction, decay, mean) in zip(self.relaxing_n, parts, strict=True)
            ]
        )
        force_n = elastic_n * (1.0 - sum(obj.relaxing_fractions)) + sum(relaxing_n)
        return RelaxingForce(elastic_n, relaxing_n, max(force_n, 0.0) if touching else 0.0)


def _relaxation_steps(obj: TwinObject, step_s: float) -> list[tuple[float, float, float]]:
    """Return fraction, decay and mean decay over a step of every relaxing part."""
    parts = []
    for fraction, time_s in zip(obj.relaxing_fractions, obj.relaxing_time_s, strict=True):
        rate = max(step_s / time_s, 1e-12)
        fall = math.expm1(-rate)
        parts.append((fraction, 1.0 + fall, -fall / rate))
    return parts
