"""What an item is: the answer of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What an item is.

    Attributes
    ----------
    kind : str
        The most probable kind, or `UNKNOWN` if it is rejected.
    probability : mapping of str to float
        Of each kind that was taught, and of something else under `UNKNOWN`; the sum is 1.
    usual : float
        Share of the taught items that are at most as usual as this one: small for strangers.
    rejected : bool
        Whether it is unknown at the stated level.
    grasps : int
        Grasps that went into it.
    """

    kind: str
    probability: Mapping[str, float]
    usual: float
    rejected: bool
    grasps: int

    @property
    def confidence(self) -> float:
        """Probability of the kind that is named; for what is unknown, the level of the test."""
        return 1.0 - self.usual if self.rejected else self.probability[self.kind]

    @property
    def best_guess(self) -> str:
        """The most probable kind, whether it is rejected or not."""
        kinds = [kind for kind in self.probability if kind != UNKNOWN]
        return max(kinds, key=self.probability.__getitem__)


def as_labelled(kind: str) -> Identity:
    """Return what is known of an item whose kind a person said.

    Examples
    --------
    >>> as_labelled("kiwi").confidence
    1.0
    """
    sure = kind != UNKNOWN
    return Identity(
        kind=kind,
        probability={kind: 1.0},
        usual=1.0 if sure else 0.0,
        rejected=not sure,
        grasps=0,
    )
