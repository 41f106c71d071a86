"""The gymnasium environment `palpate/Grasp-v0`: grasp an object with tactile feedback."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.gripper.interface import GripperCommand
from palpate.sensor.sample import SampleReader
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate_mujoco.hand import find_hand
from palpate_mujoco.world import MujocoWorld

Observation: TypeAlias = dict[str, Any]
Info: TypeAlias = dict[str, Any]

#: Frames of the rest measurement at the start of an episode.
_REST_FRAMES = 15
#: Limit of the reported relative change, percent.
_LIMIT_PERCENT = 100.0
#: Height and width of a rendered image.
_IMAGE_SIZE = 240, 320
#: Cost of damage, in units of the cost of a step without force.
_DAMAGE_COST = 20.0


class GraspEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One grasp in MuJoCo, a frame of the sensor at each step.

    Observation: `change_percent`, change of each pixel's resistance relative to rest, shape
    (rows, cols), and `width_mm`, the opening read by the servo, shape (1,). Action: target opening
    at a fixed speed, from -1 (closed) to 1 (open). Reward: minus the relative error of the grip
    force, minus a cost when the object is damaged, which ends the episode. `info["truth"]` contains
    the true state of the simulation.

    Parameters
    ----------
    object_name : str, optional
        Object to grasp (`palpate.twin.objects.OBJECTS`); drawn at each reset by default.
    target_force_n : float
        Target grip force.
    rate_mm_per_s : float
        Speed of the fingers.
    level : {"lab", "field"}
        Scatter of the sheets; each reset draws a new sheet.
    hand : {"widowx", "so101"}
        Model of the hand.
    render_mode : {"rgb_array"}, optional
        Enables `render`. Without a display, MuJoCo requires ``MUJOCO_GL=egl`` or ``osmesa`` before
        Python starts.

    Raises
    ------
    InputError
        If the object or hand is unknown.

    Examples
    --------
    >>> env = gymnasium.make("palpate/Grasp-v0", object_name="springs-4")
    >>> seen, info = env.reset(seed=1)
    >>> seen["change_percent"].shape, seen["width_mm"].round().tolist()
    ((4, 2), [74.0])
    >>> seen, reward, terminated, truncated, info = env.step(np.array([0.5], dtype=np.float32))
    >>> round(reward, 2), info["truth"]["force_n"]
    (-1.0, 0.0)
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012 - gymnasium's own form

    def __init__(
        self,
        *,
        object_name: str | None = None,
        target_force_n: float = 3.0,
        rate_mm_per_s: float = 20.0,
        level: str = "lab",
        hand: str = "widowx",
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        if object_name is not None and object_name not in OBJECTS:
            raise InputError(
                f"no simulated object {object_name!r}; available: {', '.join(OBJECTS)}"
            )
        self._object_name, self._level, self._hand = object_name, level, find_hand(hand)
        self._target_force_n, self._rate_mm_per_s = target_force_n, rate_mm_per_s
        self.render_mode = render_mode
        self._renderer: mujoco.Renderer | None = None
        self._open(seed=0)
        layout, limits = self._array.layout, self._gripper.limits
        self._lowest_mm, self._span_mm = limits.lowest, limits.span
        self.observation_space = gymnasium.spaces.Dict(
            {
                "change_percent": gymnasium.spaces.Box(
                    -_LIMIT_PERCENT, _LIMIT_PERCENT, (layout.rows, layout.cols)
                ),
                "width_mm": gymnasium.spaces.Box(0.0, limits.highest + limits.lowest, (1,)),
            }
        )
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Draw a new sheet and object, open the hand and measure the rest values."""
        super().reset(seed=seed)
        self._open(seed=int(self.np_random.integers(2**31)))
        ohm = [self._ohm() for _ in range(_REST_FRAMES)]
        self._rest_ohm = np.mean(ohm, axis=0)
        return self._measure(ohm[-1]), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, Info]:
        """Command the fingers and read one frame."""
        opening = 0.5 + 0.5 * float(np.clip(action, -1.0, 1.0)[0])
        target_mm = self._lowest_mm + opening * self._span_mm
        self._gripper.command(GripperCommand(target=target_mm, rate=self._rate_mm_per_s))
        observation, info = self._measure(self._ohm()), self._info()
        truth = info["truth"]
        reward = -abs(truth["force_n"] / self._target_force_n - 1.0)
        reward -= _DAMAGE_COST * truth["damaged"]
        return observation, reward, truth["damaged"], False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image from the front, shape (240, 320, 3); None without a `render_mode`.

        Raises `InputError` if OpenGL cannot render.
        """
        if self.render_mode is None:
            return None
        if self._renderer is None:
            try:
                self._renderer = mujoco.Renderer(self._world.model, *_IMAGE_SIZE)
            except (mujoco.FatalError, RuntimeError, AttributeError, ImportError) as error:
                raise InputError(
                    "MuJoCo can't render: set MUJOCO_GL=egl or osmesa before Python starts "
                    f"({error})"
                ) from error
        self._renderer.update_scene(self._world.data, camera="front")
        image: NDArray[np.uint8] = self._renderer.render()
        return image

    def close(self) -> None:
        """Close the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _open(self, *, seed: int) -> None:
        self.close()  # the renderer belongs to the previous model
        obj = draw_object(np.random.default_rng([seed, 10]), self._object_name)
        self._world = MujocoWorld(obj, seed=seed, level=self._level, hand=self._hand)
        self._array, self._gripper = TwinArray(self._world), TwinGripper(self._world)
        self._obj = obj

    def _ohm(self) -> FloatArray:
        frame = self._array.read(timeout_s=1.0)
        return SampleReader(self._array.layout).read(frame).resistance_ohm

    def _measure(self, ohm: FloatArray) -> Observation:
        reader = SampleReader(self._array.layout, self._rest_ohm)
        change_percent = reader.read_ohm(ohm).change_percent
        # An open pixel has no finite change and gets the limit.
        change_percent = np.nan_to_num(change_percent, nan=_LIMIT_PERCENT)
        change_percent = np.clip(change_percent, -_LIMIT_PERCENT, _LIMIT_PERCENT)
        width_mm = np.array([self._gripper.state().width_mm])
        return {
            "change_percent": change_percent.astype(np.float32),
            "width_mm": width_mm.astype(np.float32),
        }

    def _info(self) -> Info:
        world = self._world
        return {
            "time_s": world.now_s(),
            "truth": {
                "object": self._obj.name,
                "size_mm": self._obj.size_mm,
                "force_n": world.force_n(world.now_s()),
                "peak_force_n": world.peak_force_n,
                "damaged": world.is_damaged,
            },
        }


#: Id of the environment; `gymnasium.make("palpate_mujoco.env:palpate/Grasp-v0")` imports this file.
ENV_ID = "palpate/Grasp-v0"
if ENV_ID not in gymnasium.registry:
    gymnasium.register(ENV_ID, entry_point="palpate_mujoco.env:GraspEnv", max_episode_steps=300)
