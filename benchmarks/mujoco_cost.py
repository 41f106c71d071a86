"""Cost of the sensor in a MuJoCo simulation: steps per second with and without it.

    python benchmarks/mujoco_cost.py

The WidowX-like hand holds an object, alone or at the end of an arm of six joints that holds a free
ball above a floor, in steps of 1 ms. With the sensor, frames are read 15 times a second, and
contacts are evaluated once per frame or as often as in the rig. Runs with and without the sensor
take turns, and processor time is measured, because other programs share the machine. The exit
status is 1 if the sensor at one evaluation per frame is more than 30 % slower. Requires
`pip install -e packages/mujoco`.
"""

from __future__ import annotations

import argparse
import copy
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

import mujoco
import numpy as np

from palpate.twin.devices import TwinArray
from palpate.twin.objects import draw_object
from palpate.twin.world import OPEN_MM
from palpate_mujoco import MujocoWorld, Pad, PadSensor
from palpate_mujoco.hand import WIDOWX, Servo
from palpate_mujoco.world import EVERY_S

MAX_SLOWDOWN = 0.30
#: The hand at the end of the arm.
ON_ARM = replace(
    WIDOWX,
    servo="arm_servo",
    joints=("arm_left", "arm_right"),
    pads=(Pad(geom="arm_left_pad"), Pad(geom="arm_right_pad")),
)


def create_holding_world(name: str) -> MujocoWorld:
    """Return a world in which the hand holds an object."""
    obj = draw_object(np.random.default_rng(1), name)
    world = MujocoWorld(obj, seed=1)
    world.drive(obj.size_mm - 2.0, rate=20.0)
    world.clock.sleep_s(4.0)
    world.force_n(world.now_s())
    return world


def create_arm() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return an arm of six joints with the hand holding a ball of 50 mm."""
    spec, hand = mujoco.MjSpec(), WIDOWX.spec()
    spec.option = hand.option
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    link, up_m = spec.worldbody, 0.05
    for number, axis in enumerate(
        ([0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1])
    ):
        link = link.add_body(pos=[0, 0, up_m])
        link.add_joint(name=f"arm{number}", axis=axis, damping=[2.0, 0, 0], armature=0.1)
        up_m = 0.12
        link.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0.03, 0, 0, 0.09], size=[0.02, 0, 0]
        )
        arm = spec.add_actuator(target=f"arm{number}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        arm.gainprm[0], arm.biastype = 500.0, mujoco.mjtBias.mjBIAS_AFFINE
        arm.biasprm[:3] = [0.0, -500.0, -20.0]
    # The hand points down from its palm; turned, it points away from the arm.
    turned = link.add_frame(pos=[0, 0, 0.22], quat=[0, 0, 1, 0])
    turned.attach_body(hand.body("palm"), "arm_", "")
    ball = spec.worldbody.add_body(pos=[0, 0, 0.05 + 5 * 0.12 + 0.22])
    ball.gravcomp = 1.0  # until it is held
    ball.add_freejoint()
    ball.add_geom(size=[0.025, 0, 0], mass=0.06, condim=4)
    model = spec.compile()
    data = mujoco.MjData(model)
    servo = Servo(ON_ARM, model=model, data=data)
    servo.set_width(OPEN_MM)
    servo.move_towards(49.0, within_s=1.0)
    mujoco.mj_step(model, data, 1000)
    servo.move_towards(49.0, within_s=1.0)
    mujoco.mj_step(model, data, 1000)
    return model, data


def time_work(work: Callable[[], None]) -> float:
    """Return the processor time of some work, seconds."""
    before_s = time.process_time()
    work()
    return time.process_time() - before_s


def measure_model(
    name: str,
    model: mujoco.MjModel,
    held: mujoco.MjData,
    pads: Sequence[Pad],
    *,
    every_s: float,
    seconds: float,
    rounds: int,
) -> float:
    """Print a row; return the relative slowdown by the sensor."""
    bare = copy.copy(held)
    sensor = PadSensor(model, copy.copy(held), pads=pads, seed=1, every_s=every_s)
    array = TwinArray(sensor)
    steps = round(every_s / model.opt.timestep)

    def without() -> None:
        for _ in range(round(seconds / every_s)):
            mujoco.mj_step(model, bare, steps)

    def with_sensor() -> None:
        until_s = sensor.clock.now_s() + seconds
        while sensor.clock.now_s() < until_s:
            array.read(timeout_s=1.0)

    pairs = [(time_work(without), time_work(with_sensor)) for _ in range(rounds)]
    assert sensor.load_n.any()
    slower = median(after / before for before, after in pairs) - 1.0
    rates = [seconds / model.opt.timestep / median(column) for column in zip(*pairs, strict=True)]
    frame_s = median(after - before for before, after in pairs) / (seconds * sensor.frame_rate_hz)
    print(
        f"{name:17} {held.ncon:2} contacts, evaluated every {1e3 * every_s:3.0f} ms: "
        f"{rates[0]:8,.0f} steps/s without, {rates[1]:8,.0f} with: {100 * slower:+.0f} %, "
        f"{1e6 * frame_s:.0f} µs a frame"
    )
    return slower


def main() -> None:
    """Measure holds with few and with many contacts, and one with an arm."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, of each run")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    held = {"arm and free ball": (*create_arm(), ON_ARM.pads)}
    for name in ("ball-44lbs", "springs-4"):
        world = create_holding_world(name)
        held[name] = (world.model, world.data, WIDOWX.pads)
    slower = [
        measure_model(name, *state, every_s=1 / 15, seconds=options.seconds, rounds=options.rounds)
        for name, state in held.items()
    ]
    for name, state in held.items():
        measure_model(name, *state, every_s=EVERY_S, seconds=options.seconds, rounds=options.rounds)
    sys.exit(max(slower) > MAX_SLOWDOWN)


if __name__ == "__main__":
    main()
