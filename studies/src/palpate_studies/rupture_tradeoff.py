"""How firm a grip each way of stopping gives, at equal rates of rupture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from palpate.estimate.fruit_closings import FruitClosing
from palpate_studies.rupture_policies import Scored, stop_forces

#: Rates of rupture at which methods are compared.
RATES = (0.01, 0.02, 0.03, 0.05, 0.075, 0.10)
#: Settings tried per method: each score that any closing passed would do; so many are plenty.
SETTINGS = 400
LEVEL = 0.9


class Method(NamedTuple):
    """A way of stopping: its scores along each closing; it stops at a chosen one."""

    name: str
    scores: Sequence[Scored]


def tradeoff(
    methods: Sequence[Method], *, closings: Sequence[FruitClosing]
) -> list[dict[str, Any]]:
    """Sweep each method over its setting and report the firmest grip at each rate of rupture.

    Parameters
    ----------
    methods : sequence of Method
    closings : sequence of FruitClosing
        Those that the scores belong to.

    Returns
    -------
    list of dict
        ``fruit`` (or "all"), ``method``, ``rate_limit``, ``setting``, ``ruptured``, ``grasps``,
        ``rupture_rate`` with its binomial 90 % bounds ``rate_low`` and ``rate_high`` (Clopper and
        Pearson), and ``firmness``: mean stop force as a share of the rupture force.
    """
    limits_n = np.array([closing.rupture_force_n for closing in closings])
    entries = []
    for fruit in [*sorted({closing.fruit for closing in closings}), "all"]:
        chosen = [i for i, closing in enumerate(closings) if fruit in ("all", closing.fruit)]
        of_chosen_n = limits_n[chosen][:, None]
        for method in methods:
            scores = [method.scores[i] for i in chosen]
            every = np.concatenate([one.score for one in scores])
            settings = np.unique(np.quantile(every, np.linspace(0, 1, SETTINGS)))
            stops_n = stop_forces(scores, rupture_force_n=limits_n[chosen].tolist(), at=settings)
            ruptured = np.sum(stops_n >= of_chosen_n, axis=0)
            firmness = np.mean(stops_n / of_chosen_n, axis=0)
            for rate in RATES:
                allowed = np.where(ruptured <= rate * len(chosen), firmness, -np.inf)
                best = int(np.argmax(allowed))
                entries.append(
                    {
                        "fruit": fruit,
                        "method": method.name,
                        "rate_limit": rate,
                        "setting": float(settings[best]),
                        "grasps": len(chosen),
                        "ruptured": int(ruptured[best]),
                        "rupture_rate": float(ruptured[best] / len(chosen)),
                        **_bounds(int(ruptured[best]), len(chosen)),
                        "firmness": float(firmness[best]),
                    }
                )
    return entries


def _bounds(count: int, total: int) -> dict[str, float]:
    tail = (1 - LEVEL) / 2
    low = beta.ppf(tail, count, total - count + 1) if count else 0.0
    high = beta.ppf(1 - tail, count + 1, total - count) if count < total else 1.0
    return {"rate_low": float(low), "rate_high": float(high)}
