"""The environment follows gymnasium's rules and rewards the target grip force."""

from __future__ import annotations

import os
import subprocess
import sys
from ctypes.util import find_library

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from palpate.errors import InputError
from palpate_mujoco.env import GraspEnv

NAME = "palpate_mujoco.env:palpate/Grasp-v0"


@pytest.mark.parametrize("hand", ["widowx", "so101"])
def test_env_passes_gymnasiums_check(hand: str) -> None:
    # Rendering is checked below, in its own process.
    check_env(gymnasium.make(NAME, hand=hand).unwrapped, skip_render_check=True)


def test_step_closing_further_increases_force_and_change() -> None:
    env = gymnasium.make(NAME, object_name="springs-4", target_force_n=4.0)
    env.reset(seed=2)
    seen = []
    # 0.5, 1.5 and 2.5 mm below the size of the springs; the opening ranges from 5 to 74 mm.
    for width_mm in (44.5, 43.5, 42.5):
        action = np.array([2.0 * (width_mm - 5.0) / 69.0 - 1.0], dtype=np.float32)
        for _ in range(45):
            observation, reward, terminated, _, info = env.step(action)
        assert not terminated
        seen.append((observation["change_percent"].mean(), info["truth"]["force_n"], reward))
        assert observation["width_mm"][0] == pytest.approx(width_mm, abs=0.15)
    changes, forces_n, rewards = zip(*seen, strict=True)
    assert changes[0] > changes[1] > changes[2]
    assert forces_n[0] < forces_n[1] < forces_n[2]
    assert rewards == pytest.approx([-abs(force_n / 4.0 - 1.0) for force_n in forces_n])


def test_damage_terminates_episode_with_cost() -> None:
    env = gymnasium.make(NAME, object_name="strawberry")
    env.reset(seed=2)
    terminated = False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.array([-1.0], dtype=np.float32))
        assert not truncated
    assert info["truth"]["damaged"]
    assert reward < -20.0


def test_episode_is_truncated_after_300_steps() -> None:
    env = gymnasium.make(NAME, object_name="apple")
    env.reset(seed=1)
    ends = [env.step(np.array([1.0], dtype=np.float32))[3] for _ in range(300)]
    assert ends.index(True) == 299


def test_unknown_object_or_hand_is_refused() -> None:
    with pytest.raises(InputError, match="no simulated object 'anvil'"):
        GraspEnv(object_name="anvil")
    with pytest.raises(InputError, match=r"no hand 'claw' in MuJoCo; available: widowx, so101"):
        GraspEnv(hand="claw")


def run_with(gl: str, *lines: str) -> subprocess.CompletedProcess[str]:
    """Run Python with an OpenGL backend, which MuJoCo selects on import."""
    text = "\n".join(("import gymnasium", f"NAME = {NAME!r}", *lines))
    environment = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    return subprocess.run(
        [sys.executable, "-c", text],
        env=environment | {"MUJOCO_GL": gl},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.skipif(find_library("EGL") is None, reason="libEGL is not installed")
def test_env_with_rendering_passes_gymnasiums_check() -> None:
    done = run_with(
        "egl",
        "from gymnasium.utils.env_checker import check_env",
        'env = gymnasium.make(NAME, render_mode="rgb_array", object_name="tomato")',
        "check_env(env.unwrapped)",
        "env.reset(seed=1)",
        "first = env.render()",
        "env.step(env.action_space.high * -1)",
        "for _ in range(15): env.step(env.action_space.low)",
        "print(first.shape, first.dtype, (env.render() != first).any())",
    )
    assert done.stdout == "(240, 320, 3) uint8 True\n", done.stderr


def test_render_without_opengl_raises_clear_error() -> None:
    done = run_with(
        "glfw",
        'env = gymnasium.make(NAME, render_mode="rgb_array", object_name="tomato")',
        "env.reset(seed=1)",
        "env.render()",
    )
    assert "InputError: MuJoCo can't render: set MUJOCO_GL=egl or osmesa" in done.stderr
