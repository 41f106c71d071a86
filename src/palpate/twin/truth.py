"""What really holds in a world: the answers that a grasp is compared with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What really holds in a world; names and meanings as in the answers of `palpate grasp`."""

    #: Extent of the object along the closing axis before contact; None if there is none.
    size_mm: float | None
    #: Mean relative change over all pixels at the horizon of the final hold.
    settled_percent: float
    #: Grip force, the mean of the fingers' normal forces, at that horizon.
    force_n: float
    #: The object's own secant stiffness at that force; None without contact.
    stiffness_n_per_mm: float | None
    #: Largest contact force up to now.
    peak_force_n: float
    #: Whether the force ever passed the object's yield force.
    damaged: bool

    def as_json(self) -> dict[str, float | bool | None]:
        """Return the form that commands print."""
        return {name: getattr(self, name) for name in self.__slots__}
