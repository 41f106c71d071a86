"""The options of a served station."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from palpate.object.damage_file import DamageFile
from palpate_station.qualify.conversion import Conversion
from palpate_station.sorting.rules import RuleBook


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The options of `palpate serve`."""

    #: Available rigs; the first is opened at the start.
    rigs: tuple[str, ...]
    #: Available objects of simulated rigs.
    objects: tuple[str, ...]
    #: Folder of the recordings and of the calibrations of simulated rigs.
    folder: Path
    #: Path or URL of the item store; None for the default store.
    store: str | None
    #: Object, seed and speed of the first rig, if it is simulated.
    object_name: str | None
    seed: int
    speed: float
    #: Frame rate of simulated rigs, Hz; None for their own.
    rate_hz: float | None = None
    #: Learned damage limits of the grasps, and their file.
    damage: DamageFile | None = None
    damage_path: Path | None = None
    #: Sorting rules that assign each item to a bin.
    rules: RuleBook | None = None
    #: Translation of the operator's page; English by default.
    words: Path | None = None
    #: Whether a grasp without the name of its item is refused, in addition to the rules.
    requires_item: bool = False
    #: Time without working devices after which the server ends; None to stay.
    exit_after_s: float | None = None
    #: Conversion of the answers to the unit of a buyer's instrument.
    reference: Conversion | None = None
    #: Name of this station.
    station: str | None = None
    #: Days after which recordings of grasps are deleted; None to keep them.
    keep_days: float | None = None

    @property
    def existing_folder(self) -> Path:
        """The folder, or while it does not exist its nearest parent that does."""
        folder = self.folder.absolute()
        return next(one for one in (folder, *folder.parents) if one.exists())
