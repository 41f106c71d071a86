"""What really holds in a world: the answers that a grasp is compared with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What really holds in a world; names and meanings as in the answers of `palpate grasp`.

    Attributes
    ----------
    size_mm : float or None
        Extent of the object along the closing axis before contact; None if there is none.
    settled_percent : float
        Mean relative change over all pixels at the horizon of the final hold.
    force_n : float
        Grip force, the mean of the fingers' normal forces, at that horizon.
    stiffness_n_per_mm : float or None
        The object's own secant stiffness at that force; None without contact.
    peak_force_n : float
        Largest contact force up to now.
    damaged : bool
        Whether the force ever passed the object's yield force.
    """

    size_mm: float | None
    settled_percent: float
    force_n: float
    stiffness_n_per_mm: float | None
    peak_force_n: float
    damaged: bool

    def as_json(self) -> dict[str, float | bool | None]:
        """Return the form that commands print."""
        return {name: getattr(self, name) for name in self.__slots__}
