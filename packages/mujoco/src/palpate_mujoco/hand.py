"""Grippers as MuJoCo models: positions of their pads, and opening by servo angle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

import mujoco

from palpate.errors import InputError
from palpate.gripper.fingers import HingedJaw
from palpate_mujoco.pads import Pad

_OPENING_MM = 2e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """A gripper of two fingers on one servo, with the twin's opening range.

    Attributes
    ----------
    model : str
        File in `palpate_mujoco/hands`. The servo's command is a speed, and its state is the target
        position (MuJoCo's `intvelocity`).
    servo : str
        Name of the servo.
    joints : tuple of str
        Joints of the moving fingers with equal values, starting with the servo's.
    pads : tuple of Pad
        One pad per finger, facing each other along x, starting with the pad at lower x.
    width_mm, position : callable
        From a joint's value to the opening that a real gripper reports, mm, and back.
    fixed_face_mm : float or None
        Position on x of the first pad's face, if its finger does not move.
    """

    model: str
    servo: str
    joints: tuple[str, ...]
    pads: tuple[Pad, Pad]
    width_mm: Callable[[float], float]
    position: Callable[[float], float]
    fixed_face_mm: float | None = None

    def spec(self) -> mujoco.MjSpec:
        """Return the model specification, for extension and compilation."""
        return mujoco.MjSpec.from_file(str(files("palpate_mujoco") / "hands" / self.model))

    def place_mm(self, size_mm: float, *, lead_mm: float, first_finger: int) -> float:
        """Return the x of an object that one finger touches `lead_mm` before the other.

        If only one finger moves, it is always the first to touch.
        """
        if self.fixed_face_mm is not None:
            return self.fixed_face_mm + 0.5 * size_mm + lead_mm
        return 0.5 * lead_mm * (1 if first_finger else -1)


#: Like the WidowX 250 S's: opens to 74 mm; each joint has half of the opening, metres.
WIDOWX = Hand(
    model="widowx.xml",
    servo="servo",
    joints=("left", "right"),
    pads=(Pad(geom="left_pad"), Pad(geom="right_pad")),
    width_mm=lambda half_m: _OPENING_MM * half_m,
    position=lambda width_mm: width_mm / _OPENING_MM,
)
#: Conversion of `palpate.gripper.feetech` for the opening of an SO-101: distance from the hinge to
#: the middle of the pad, and angle from the closed position.
_JAW = HingedJaw(jaw_mm=64.0)
#: Like the SO-101's: one fixed jaw and one that swings.
SO101 = Hand(
    model="so101.xml",
    servo="servo",
    joints=("jaw",),
    pads=(Pad(geom="fixed_pad"), Pad(geom="moving_pad")),
    width_mm=_JAW.width_mm,
    position=_JAW.angle_rad,
    fixed_face_mm=-19.0,
)
#: Name -> hand.
HANDS = {"widowx": WIDOWX, "so101": SO101}


def find_hand(name: str) -> Hand:
    """Return a hand by name.

    Raises
    ------
    InputError
        If the name is unknown.
    """
    if name not in HANDS:
        raise InputError(f"no hand {name!r} in MuJoCo; available: {', '.join(HANDS)}")
    return HANDS[name]


class Servo:
    """The servo of a gripper in one model: opening in mm, at constant speed.

    Parameters
    ----------
    hand : Hand
        Hand with the names of servo and joints.
    model, data : MjModel, MjData
        Model and state that contain the hand.
    """

    def __init__(self, hand: Hand, *, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._data, self._hand = data, hand
        self._ctrl = model.actuator(hand.servo).id
        self._act = int(model.actuator(hand.servo).actadr[0])
        self._joint = int(model.joint(hand.joints[0]).qposadr[0])

    @property
    def width_mm(self) -> float:
        """Opening read by the servo's encoder."""
        return self._hand.width_mm(float(self._data.qpos[self._joint]))

    def set_width(self, width_mm: float) -> None:
        """Place the fingers at an opening, at rest."""
        position = self._hand.position(width_mm)
        self._data.act[self._act] = position
        for joint in self._hand.joints:
            self._data.joint(joint).qpos = position

    def move_towards(self, width_mm: float, *, within_s: float) -> None:
        """Set the speed that reaches an opening after a time."""
        travel = self._hand.position(width_mm) - float(self._data.act[self._act])
        self._data.ctrl[self._ctrl] = travel / within_s
