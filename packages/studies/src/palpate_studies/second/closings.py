"""Closings on simulated fruit that ruptures by another rule than the damage models assume.

The generator was fixed before anything was scored on it. Damage models and rules assume a rupture
force that depends on the stiffness, with unimodal scatter. Here a fruit ruptures at a fixed
deformation, independent of the stiffness. Each kind has two ripenesses; one ruptures at two thirds
of the other's deformation, and the curve before does not show which. The kinds are those of
`second.objects`: a skin on softer flesh with a core; foam, which stiffens faster than a round
object; dough, whose force depends on the closing speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from palpate.arrays import FloatArray
from palpate.object.damage_learning import FruitClosing, follow_closing
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.ranges import draw_log_uniform
from palpate_studies.second.objects import make_dough, make_foam, make_layered

#: Seed of everything drawn here.
SEED = 96_500
#: Kind -> fruit with the same size and stiffness, and the function that changes its curve.
_KINDS: Mapping[str, tuple[str, Callable[[TwinObject], TwinObject]]] = {
    "layered": ("mango", make_layered),
    "foam": ("kiwi", make_foam),
    "dough": ("banana", make_dough),
}
#: Fruit per kind; the total is that of the real recordings.
_FRUITS = 54
#: Deformation at rupture of the two ripenesses, mm, and its scatter (log sd).
_RUPTURE_MM, _RUPTURE_LOG_SD = (2.1, 3.2), 0.06
#: Stiffness of the hand, N/mm, and its speed, mm/s.
_HAND_N_PER_MM, _SPEED_MM_PER_S = 8.0, (0.3, 3.0)
#: Recording: first force, N, step of the deformation, mm, and noise of the force, N.
_BEGINS_N, _STEP_MM, _NOISE_N = (0.2, 1.0), 0.01, 0.02


def other_closings(*, seed: int = SEED) -> list[FruitClosing]:
    """Draw closings until rupture on each kind in turn."""
    rng = np.random.default_rng(seed)
    return [
        _draw_closing(rng, f"{kind}-{number:02d}", kind=kind, fruit=form(draw_object(rng, drawn)))
        for number in range(1, _FRUITS + 1)
        for kind, (drawn, form) in _KINDS.items()
    ]


def _draw_closing(
    rng: np.random.Generator, name: str, *, kind: str, fruit: TwinObject
) -> FruitClosing:
    rupture_mm = float(rng.choice(_RUPTURE_MM) * np.exp(_RUPTURE_LOG_SD * rng.standard_normal()))
    deformed_mm = np.arange(0.0, rupture_mm, _STEP_MM)
    step_s = _STEP_MM / draw_log_uniform(rng, _SPEED_MM_PER_S)
    true_n = _relax(_elastic_force_n(fruit, deformed_mm), fruit=fruit, step_s=step_s)
    read_n = true_n + _NOISE_N * rng.standard_normal(true_n.size)
    closure_mm = fruit.size_mm + deformed_mm + true_n / _HAND_N_PER_MM
    recorded = true_n >= draw_log_uniform(rng, _BEGINS_N)
    return follow_closing(
        name,
        fruit=kind,
        rupture_force_n=float(true_n.max()),
        closure_mm=closure_mm[recorded],
        force_n=read_n[recorded],
    )


def _elastic_force_n(fruit: TwinObject, deformed_mm: FloatArray) -> FloatArray:
    if fruit.curve is None:
        return np.asarray(fruit.force_at_1mm_n * deformed_mm**fruit.exponent)
    at_mm, force_n = np.array(fruit.curve).T
    return np.asarray(np.interp(deformed_mm, at_mm, force_n))


def _relax(elastic_n: FloatArray, *, fruit: TwinObject, step_s: float) -> FloatArray:
    """Return the force with relaxation."""
    relaxed_n = elastic_n.copy()
    for fraction, time_s in zip(fruit.relaxing_fractions, fruit.relaxing_time_s, strict=True):
        gain, lagging = -np.expm1(-step_s / time_s), 0.0
        for k, now in enumerate(elastic_n.tolist()):
            lagging += gain * (now - lagging)
            relaxed_n[k] -= fraction * lagging
    return relaxed_n
