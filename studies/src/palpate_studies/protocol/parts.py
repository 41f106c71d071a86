"""Training and test parts, kept apart in code.

Whatever was fitted or chosen carries the names of the specimens that it has seen. It can be used
only through `on`, which refuses specimens among them. So a score of what a setting was chosen on is
no matter of discipline: it cannot be computed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from palpate.errors import InputError

Found = TypeVar("Found")


class SeenBeforeError(InputError):
    """A score was asked for on specimens that the method or its setting has seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned(Generic[Found]):
    """A part that was fitted or chosen, with the specimens that it rests on.

    Attributes
    ----------
    found : object
        A setting, a function, a model. Use `on` to get at it for a test.
    seen : frozenset of str
        Specimens that it was fitted to or chosen on.

    Examples
    --------
    >>> gain = Learned(found=1.2, seen=frozenset({"sensor-1", "sensor-2"}))
    >>> gain.on(["sensor-3"])
    1.2
    >>> gain.on(["sensor-1", "sensor-3"])
    Traceback (most recent call last):
    palpate_studies.protocol.parts.SeenBeforeError: sensor-1 was used for fitting or choosing; \
score on other specimens
    """

    found: Found
    seen: frozenset[str]

    def on(self, specimens: Iterable[str]) -> Found:
        """Return what was learned, to be used on these specimens.

        Raises
        ------
        SeenBeforeError
            If it has seen any of them.
        """
        overlap = sorted(self.seen & set(specimens))
        if overlap:
            named = ", ".join(overlap[:3]) + (" and others" if len(overlap) > 3 else "")
            was = "was" if len(overlap) == 1 else "were"
            raise SeenBeforeError(
                f"{named} {was} used for fitting or choosing; score on other specimens"
            )
        return self.found
