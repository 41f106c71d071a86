"""The force of an object that relaxes while it shares its closure with a gripper that gives way.

The object's elastic force E(x) is remembered by parts that fade: of every change of E a share s_k
dies away with the time constant tau_k. Over one step in which E goes in a line, the force is then
a straight line in the new E, F = kept E + carried, and the balance with the gripper is one equation
in the deformation x. So an object between stiff fingers relaxes, and one between fingers that keep
their force creeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from palpate.twin.mechanics import Compliance, series_force_n
from palpate.twin.objects import TwinObject


@dataclass(frozen=True, slots=True)
class Squeeze:
    """An object's elastic force, the parts of it that are fading, and the force that is left."""

    elastic_n: float = 0.0
    relaxing_n: tuple[float, ...] = ()
    force_n: float = 0.0

    @classmethod
    def none(cls, obj: TwinObject | None) -> Self:
        """Return the squeeze of an object that nothing has touched yet."""
        return cls(relaxing_n=() if obj is None else (0.0,) * len(obj.relaxing_share))

    def closed(
        self,
        obj: TwinObject,
        closure_mm: float,
        *,
        step_s: float,
        compliance: Compliance,
        ruptured: bool = False,
    ) -> Squeeze:
        """Return the squeeze after a step that ends at a closure; 0 and below is no contact."""
        if closure_mm <= 0:
            return self.changed(obj, elastic_n=0.0, step_s=step_s, touching=False)
        parts = _fading(obj, step_s)
        fresh = sum(share * mean for share, _, mean in parts)
        carried_n = sum(n * decay for n, (_, decay, _) in zip(self.relaxing_n, parts, strict=True))
        elastic_n = series_force_n(
            obj,
            closure_mm,
            compliance=compliance,
            ruptured=ruptured,
            kept=1.0 - sum(obj.relaxing_share) + fresh,
            carried_n=carried_n - self.elastic_n * fresh,
        )
        return self.changed(obj, elastic_n=elastic_n, step_s=step_s)

    def changed(
        self, obj: TwinObject, *, elastic_n: float, step_s: float, touching: bool = True
    ) -> Squeeze:
        """Return the squeeze after a step over which the elastic force went in a line."""
        relaxing_n = tuple(
            before * decay + share * (elastic_n - self.elastic_n) * mean
            for before, (share, decay, mean) in zip(
                self.relaxing_n, _fading(obj, step_s), strict=True
            )
        )
        force_n = elastic_n * (1.0 - sum(obj.relaxing_share)) + sum(relaxing_n)
        return Squeeze(elastic_n, relaxing_n, max(force_n, 0.0) if touching else 0.0)


def _fading(obj: TwinObject, step_s: float) -> list[tuple[float, float, float]]:
    """Return share, decay and mean decay over a step of every part that fades."""
    parts = []
    for share, time_s in zip(obj.relaxing_share, obj.relaxing_time_s, strict=True):
        rate = max(step_s / time_s, 1e-12)
        fall = math.expm1(-rate)
        parts.append((share, 1.0 + fall, -fall / rate))
    return parts
