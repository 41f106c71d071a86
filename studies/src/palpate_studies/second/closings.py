"""Closings on simulated fruit that ruptures by another rule than any guard expects.

Fixed before anything was scored on it. Guard and rules expect a rupture force that follows from the
stiffness, with a scatter of one hump. Here a fruit ruptures at a deformation, whatever its
stiffness: each kind has two ripenesses, of which one gives way at two thirds of the other's
deformation, and nothing before it shows which. The kinds are those of `second.things`: a skin on
softer flesh with a core; foam, which stiffens faster than a round object; dough, whose force
depends on how fast it is closed on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.damage_learning import FruitClosing, follow_closing
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import log_uniform
from palpate_studies.second.things import dough, draw_layered, foam

#: Seed of everything drawn here.
SEED = 96_500
#: Kind -> whose size and stiffness it has, and its form.
_KINDS: Mapping[str, tuple[str, Callable[[TwinObject], TwinObject]]] = {
    "layered": ("mango", draw_layered),
    "foam": ("kiwi", foam),
    "dough": ("banana", dough),
}
#: Fruit of each kind; as many in all as were recorded.
_FRUITS = 54
#: Deformation at rupture of the two ripenesses, mm, and the scatter within each (log sd).
_BORNE_MM, _BORNE_LOG_SD = (2.1, 3.2), 0.06
#: The hand: its give, N/mm, and its speed, mm/s.
_HAND_N_PER_MM, _SPEED_MM_PER_S = 8.0, (0.3, 3.0)
#: A record: the force at which it begins, N, how finely it is made, mm, and noise of its force, N.
_BEGINS_N, _STEP_MM, _NOISE_N = (0.2, 1.0), 0.01, 0.02


def other_closings(*, seed: int = SEED) -> list[FruitClosing]:
    """Return closings on each kind in turn until rupture."""
    rng = np.random.default_rng(seed)
    return [
        _closing(rng, f"{kind}-{number:02d}", kind=kind, thing=form(draw_object(rng, drawn)))
        for number in range(1, _FRUITS + 1)
        for kind, (drawn, form) in _KINDS.items()
    ]


def _closing(rng: np.random.Generator, name: str, *, kind: str, thing: TwinObject) -> FruitClosing:
    borne_mm = float(rng.choice(_BORNE_MM) * np.exp(_BORNE_LOG_SD * rng.standard_normal()))
    deformed_mm = np.arange(0.0, borne_mm, _STEP_MM)
    step_s = _STEP_MM / log_uniform(rng, _SPEED_MM_PER_S)
    true_n = _relaxing(_elastic_n(thing, deformed_mm), thing=thing, step_s=step_s)
    read_n = true_n + _NOISE_N * rng.standard_normal(true_n.size)
    closure_mm = thing.size_mm + deformed_mm + true_n / _HAND_N_PER_MM
    begun = true_n >= log_uniform(rng, _BEGINS_N)
    return follow_closing(
        name,
        fruit=kind,
        rupture_force_n=float(true_n.max()),
        closure_mm=closure_mm[begun],
        force_n=read_n[begun],
    )


def _elastic_n(thing: TwinObject, deformed_mm: FloatArray) -> FloatArray:
    if thing.curve is None:
        return np.asarray(thing.force_at_1mm_n * deformed_mm**thing.exponent)
    at_mm, force_n = np.array(thing.curve).T
    return np.asarray(np.interp(deformed_mm, at_mm, force_n))


def _relaxing(elastic_n: FloatArray, *, thing: TwinObject, step_s: float) -> FloatArray:
    """Return the force that is left while shares of it relax away."""
    left_n = elastic_n.copy()
    for share, time_s in zip(thing.relaxing_share, thing.relaxing_time_s, strict=True):
        behind, lagging = -np.expm1(-step_s / time_s), 0.0
        for k, now in enumerate(elastic_n.tolist()):
            lagging += behind * (now - lagging)
            left_n[k] -= share * lagging
    return left_n
