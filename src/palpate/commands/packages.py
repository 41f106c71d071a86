"""What other packages bring to the command: found through entry points, never imported by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from palpate.errors import InputError

#: What an entry point of a catalogue leads to: name -> (place of a function, summary).
Catalogue = dict[str, tuple[str, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What one of palpate's own packages brings."""

    #: Group of entry points.
    group: str
    #: What a user typed that needs it.
    asked: str
    package: str
    #: Where it is in a copy of the source.
    folder: str

    @property
    def missing(self) -> InputError:
        """The error where it is not installed."""
        return InputError(
            f"{self.asked} needs the package {self.package}; "
            f"in a copy of the source: pip install ./{self.folder}"
        )


STUDIES = Offer(
    group="palpate.studies", asked="palpate study", package="palpate-studies", folder="studies"
)
BENCHMARKS = Offer(
    group="palpate.benchmarks", asked="palpate bench", package="palpate-studies", folder="studies"
)
ARCHIVE = Offer(
    group="palpate.archive", asked="palpate archive", package="palpate-archive", folder="archive"
)
LEROBOT = Offer(
    group="palpate.exports",
    asked="--lerobot",
    package="palpate-lerobot",
    folder="bridges/lerobot-dataset",
)


def catalogue(offer: Offer) -> Catalogue:
    """Return everything that installed packages offer in a group, nothing without one."""
    found: Catalogue = {}
    for point in entry_points(group=offer.group):
        found |= point.load()
    return found


def needed(offer: Offer) -> Catalogue:
    """Return the catalogue of an offer.

    Raises `InputError` if nobody offers anything.
    """
    if not (found := catalogue(offer)):
        raise offer.missing
    return found


def function_of(offer: Offer) -> Callable[..., Any]:
    """Return the one function of an offer.

    Raises `InputError` if it is not installed.
    """
    for point in entry_points(group=offer.group):
        function: Callable[..., Any] = point.load()
        return function
    raise offer.missing
