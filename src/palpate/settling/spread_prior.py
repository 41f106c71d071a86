"""Priors of materials whose decays are spread over log time, with a fast process at contact.

Four families of such holds are thought possible, and each hold's samples choose between them:

- *plain*: the decays are spread evenly beyond some shortest time constant and hardly deviate from
  that. Their sum is a smoothed -ln(t + t0). Carbon-black silicone is mostly like that; now and then
  a jump of the hold's own size comes first.
- *structured*: the even spread is tilted (a power law), single decays deviate freely, one decay
  near two seconds may stand out (the paper's sensor: Table 1 asks for it), and a large fast process
  that says nothing of the rest may come first. It takes more samples to be sure of it.
- *contact*: the same, seen from the actuation on: first the reading jumps as contact is made, by an
  amount that says nothing of what follows.
- *gripped*: seen from the actuation on, and the jump is some times what relaxes, as in Table 1
  (15 % of the settled change come after the first second), or, where a sheet saturates, many times:
  the jump then tells the scale.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from palpate.settling.prior import TIME_CONSTANTS_S, Prior, mixture

#: Noise of one sample, as shares of the change between 0.3 and 20 s: clean and usual, poor.
_CLEAN, _POOR = (0.003, 0.012), 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class _Family:
    """The components of one kind of hold: every shortest time, tilt, walk and noise crossed.

    The typical curve spreads its decays evenly, but for the tilt, from the shortest to the longest
    time constant. `fast`, `mode` and `jump_sd` are standard deviations of what comes on top.

    Standard deviations and amplitudes are in units of the hold's own scale. The numbers were chosen
    on half of the silicone holds, the ten Velostat ones and synthetic holds of five kinds together,
    those of contact and gripped on holds of the twin's three families too, then rounded;
    `docs/prediction.md` says what that means for the accuracies given.
    """

    odds: float
    amplitude: float
    shortest_s: tuple[float, ...]
    longest_s: float
    tilts: tuple[float, ...]
    spread: float
    walks: tuple[float, ...]
    noises: tuple[float, ...]
    fast: float
    mode: float
    mode_s: float
    mode_factor: float
    jump: float
    jump_sd: float


PLAIN = _Family(
    odds=10.0,
    amplitude=1.5,
    shortest_s=(0.3, 0.6, 1.2),
    longest_s=np.inf,
    tilts=(0.0,),
    spread=0.02,
    walks=(0.025, 0.14),
    noises=(*_CLEAN, _POOR),
    fast=0.2,
    mode=0.0,
    mode_s=1.0,
    mode_factor=1.9,
    jump=0.0,
    jump_sd=0.0,
)
#: Plain material too may begin with a jump, by about what it will relax by: grips slip into place.
PLAIN_AFTER_JUMP = replace(PLAIN, odds=1.0, jump_sd=1.0)
STRUCTURED = _Family(
    odds=1.0,
    amplitude=2.0,
    shortest_s=(0.07,),
    longest_s=np.inf,
    tilts=(0.0, -0.15, -0.3),
    spread=0.05,
    walks=(0.006, 0.024),
    noises=(*_CLEAN, _POOR),
    fast=1.5,
    mode=1.5,
    mode_s=1.0,
    mode_factor=1.9,
    jump=0.0,
    jump_sd=0.0,
)
#: A hold counted from the actuation begins with contact being made: the reading jumps by up to many
#: times what it will relax by. Table 1 puts the paper's one decay that stands out near two seconds.
#: Noise is small beside such a jump.
CONTACT = replace(
    STRUCTURED,
    odds=0.5,
    tilts=(0.0,),
    walks=(0.015,),
    noises=_CLEAN,
    mode_s=2.0,
    mode_factor=2.5,
    jump_sd=30.0,
)
#: The jump is known to a third beside what relaxes, and nothing relaxes much longer than one waits.
GRIPPED = replace(
    CONTACT,
    odds=2.0,
    amplitude=1.2,
    shortest_s=(0.2,),
    longest_s=40.0,
    fast=1.0,
    mode=1.0,
    mode_s=0.8,
    mode_factor=3.0,
    jump=10.0,
    jump_sd=3.0,
)
#: Where the relative change comes near -100 %, the jump is larger and the rest is soon over.
SATURATED = tuple(
    replace(GRIPPED, odds=1.0, shortest_s=(0.05,), tilts=(-0.4,), jump=jump, jump_sd=0.3 * jump)
    for jump in (30.0, 100.0)
)
#: The fast process at contact is over by then; the paper waits 0.5 s for it (t_a).
FAST_S = 0.1
#: Contact is over by then, but for decays of shorter time constants than this.
CONTACT_S = 0.13


def _components(family: _Family) -> Prior:
    tau = TIME_CONSTANTS_S
    fast = family.fast**2 / (1 + (tau / FAST_S) ** 4)
    off_mode = np.log(tau / family.mode_s) / np.log(family.mode_factor)
    mode = family.mode**2 * np.exp(-0.5 * off_mode**2)
    jump = 1 / (1 + (tau / CONTACT_S) ** 8)
    means, variances, walks, noises = [], [], [], []
    for shortest_s, tilt, walk, noise in itertools.product(
        family.shortest_s, family.tilts, family.walks, family.noises
    ):
        typical = np.exp(-shortest_s / tau) * tau**tilt / (1 + (tau / family.longest_s) ** 6)
        typical /= typical @ (np.exp(-0.3 / tau) - np.exp(-20.0 / tau))
        means.append(family.amplitude * typical + family.jump * jump / jump.sum())
        spread = (family.spread * typical) ** 2
        variances.append(spread + fast + mode + family.jump_sd**2 * jump)
        walks.append(walk)
        noises.append(noise)
    return Prior(
        mean_weights=np.array(means),
        weight_variance=np.array(variances),
        walk=np.array(walks),
        noise=np.array(noises),
        contact=np.full(len(walks), family.jump_sd),
        log_weight=np.full(len(walks), np.log(family.odds / len(walks))),
    )


SPREAD_PRIOR = mixture(
    [
        _components(family)
        for family in (PLAIN, PLAIN_AFTER_JUMP, STRUCTURED, CONTACT, GRIPPED, *SATURATED)
    ]
)
