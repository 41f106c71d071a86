"""Hands as MuJoCo models: where their pads are, and how the opening follows from their servo."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import mujoco

from palpate_mujoco.pads import Pad


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """A hand of two parallel fingers, driven by one servo, as wide as the twin's.

    Attributes
    ----------
    model : str
        File in `palpate_mujoco/hands`. Its servo's command is a speed, and its state the position
        that the servo goes to (MuJoCo's `intvelocity`).
    servo : str
        Its name.
    joints : tuple of str
        Joints of the fingers, that of the servo first; each reads half of the opening, metres.
    pads : tuple of Pad
        One on each finger, facing each other along x.
    """

    model: str
    servo: str
    joints: tuple[str, str]
    pads: tuple[Pad, Pad]

    def spec(self) -> mujoco.MjSpec:
        """Return the model, to add to and compile."""
        return mujoco.MjSpec.from_file(str(files("palpate_mujoco") / "hands" / self.model))


#: Like the WidowX 250 S's: 74 mm wide.
WIDOWX = Hand(
    model="widowx.xml",
    servo="servo",
    joints=("left", "right"),
    pads=(Pad(geom="left_pad"), Pad(geom="right_pad")),
)


class Servo:
    """The servo of a hand in one model: the opening in mm, on a way of constant speed.

    Parameters
    ----------
    hand : Hand
        Which names to look for.
    model, data : MjModel, MjData
        Where it is.
    """

    _OPENING_MM = 2e3

    def __init__(self, hand: Hand, *, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._data, self._hand = data, hand
        self._ctrl = model.actuator(hand.servo).id
        self._act = int(model.actuator(hand.servo).actadr[0])
        self._joint = int(model.joint(hand.joints[0]).qposadr[0])

    @property
    def width_mm(self) -> float:
        """Opening as the servo's encoder reads it."""
        return self._OPENING_MM * float(self._data.qpos[self._joint])

    def put(self, width_mm: float) -> None:
        """Put the fingers at an opening, at rest."""
        self._data.act[self._act] = width_mm / self._OPENING_MM
        for joint in self._hand.joints:
            self._data.joint(joint).qpos = width_mm / self._OPENING_MM

    def head_for(self, width_mm: float, *, within_s: float) -> None:
        """Set the speed so that the commanded opening is there after a time."""
        way_mm = width_mm - self._OPENING_MM * float(self._data.act[self._act])
        self._data.ctrl[self._ctrl] = way_mm / self._OPENING_MM / within_s
