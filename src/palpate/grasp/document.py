"""Document of a grasp, as every receiver gets it (`docs/schemas/grasp.json`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from palpate.grasp.damage_limit import DamageLimit
from palpate.grasp.pull import PullVerdict
from palpate.grasp.result import GraspResult
from palpate.grasp.verdict import verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """The bin of an item, as sorting rules decided from all its grasps.

    `rule`: line of the rule in its file; None for the default bin. `probability`: that all
    conditions of the rule are met. `again`: whether another grasp may resolve an uncertainty.
    """

    name: str
    rule: int | None = None
    probability: float | None = None
    again: bool = False
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemFacts:
    """What is known of an item besides its grasps: kind, stage of ripeness, and bruises."""

    id: str
    kind: str | None = None
    stage: str | None = None
    bruised: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspDocument:
    """A finished grasp with its task and origin, and what became of it.

    Commands print it, and the page, HTTP, MQTT, OPC UA and Modbus send it. A receiver that adds
    something, such as a bin, copies it with `dataclasses.replace`.

    Attributes
    ----------
    result : GraspResult
        What the controller measured.
    target_force_n : float or None
        Requested grip force, newtons; None for a gentle squeeze.
    limit : DamageLimit or None
        The learned damage limit, if the grasp had one.
    damage_low_n : float
        The limit for this object, newtons; infinite if the closing did not determine it.
    is_simulated : bool
        Whether any part of the rig is simulated.
    subject : str or None
        Name of the object of a simulated rig.
    truth : mapping or None
        The twin's true values, on simulated rigs only.
    pull : PullVerdict or None
        Whether friction holds a given pull.
    item_id, grasp_id : str
        Names of the item and of the grasp in the store; empty if unknown.
    recording, ended_at : str
        File name of the recording, and end of the grasp (ISO 8601, UTC); empty if unknown.
    station : str
        Name of the station; empty if unknown.
    item : ItemFacts or None
        What the store knows of the item.
    bin : Bin or None
        The item's bin.
    is_sorted : bool
        Whether there are sorting rules, so that a bin is missing where there is none.
    no_bin : str
        Why a held item has no bin; empty if it has one or was not sorted.
    reference : mapping or None
        The answer in the unit of a buyer's instrument, if the station was qualified.
    stored : bool or None
        Whether the grasp is in the store; None where nothing is stored.
    not_stored : str
        Why the grasp is not in the store; empty if it is.

    Examples
    --------
    >>> from palpate.grasp.result import Outcome
    >>> held = GraspDocument(result=GraspResult(outcome=Outcome.HELD), target_force_n=2.0)
    >>> held.to_dict()["verdict"]["text"]
    'held and released'
    """

    result: GraspResult
    target_force_n: float | None = None
    limit: DamageLimit | None = None
    damage_low_n: float = math.inf
    is_simulated: bool = False
    subject: str | None = None
    truth: Mapping[str, object] | None = None
    pull: PullVerdict | None = None
    item_id: str = ""
    grasp_id: str = ""
    recording: str = ""
    ended_at: str = ""
    station: str = ""
    item: ItemFacts | None = None
    bin: Bin | None = None
    is_sorted: bool = False
    no_bin: str = ""
    reference: Mapping[str, object] | None = None
    stored: bool | None = None
    not_stored: str = ""

    @property
    def bin_name(self) -> str:
        """Name of the bin; empty if there is none."""
        return "" if self.bin is None else self.bin.name

    @property
    def needs_regrasp(self) -> bool:
        """Whether the rules ask for another grasp of the same item: the bin is provisional."""
        return self.bin is not None and self.bin.again

    def to_dict(self) -> dict[str, object]:
        """Return the JSON form, without what is unknown."""
        limit, named = self.limit, ("item_id", "grasp_id", "recording", "ended_at", "station")
        document: dict[str, object] = {
            **self.result.to_dict(),
            "verdict": verdict(self.result, target_force_n=self.target_force_n),
            "damage_limit": limit and limit.to_dict(self.result, low_n=self.damage_low_n),
            **{name: getattr(self, name) for name in named if getattr(self, name)},
        }
        if self.is_simulated:
            document |= {"simulated": True, "object": self.subject}
        if self.truth is not None:
            document["truth"] = dict(self.truth)
        if self.item is not None:
            document["item"] = asdict(self.item)
        if self.pull is not None:
            document["pull"] = self.pull.to_dict()
        if self.is_sorted:
            document["bin"] = self.bin and asdict(self.bin)
        if self.reference is not None:
            document["reference"] = dict(self.reference)
        if self.stored is not None:
            document |= {"stored": self.stored, "not_stored": self.not_stored or None}
        return document
