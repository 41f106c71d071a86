"""The camera on the twin and on a board, through LeRobot's own registry and factory."""

from __future__ import annotations

import os
import re
import signal
from collections import deque
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import draccus
import numpy as np
import pytest
from lerobot.cameras import CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins

from palpate_studies.benchmarks.pty_board import run_board, run_on_port

register_third_party_plugins()
PAGE = Path(__file__).parents[3] / "docs/lerobot.md"


@dataclass
class Cameras:
    """The part of a robot's configuration that the page sets."""

    cameras: dict[str, CameraConfig]


def camera(rig: str, **settings: object):  # type: ignore[no-untyped-def]
    """Make the camera as a robot of LeRobot does: by its type's name."""
    config = CameraConfig.get_choice_class("palpate")(rig=rig, **settings)
    assert config.type == "palpate"
    return make_cameras_from_configs({"touch": config})["touch"]


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    """Return images of the twin until its object is squeezed."""
    taken: list[np.ndarray] = []
    with camera("sim-rigid", width=8, height=16) as touch:
        while len(taken) < 600 and (not taken or taken[-1].max() < 80):
            taken.append(touch.async_read(timeout_ms=2000))
    return taken


def test_it_is_an_image_stream_of_the_size_that_was_asked(pictures: list[np.ndarray]) -> None:
    assert {one.shape for one in pictures} == {(16, 8, 3)}
    assert {one.dtype for one in pictures} == {np.dtype(np.uint8)}


def test_a_squeeze_is_seen_where_nothing_was(pictures: list[np.ndarray]) -> None:
    assert pictures[0].max() < 20
    assert pictures[-1].max() >= 80
    assert all(np.array_equal(one[..., 0], one[..., 2]) for one in pictures), "grey"
    blocks = pictures[-1][..., 0].reshape(4, 4, 2, 4)
    assert (blocks == blocks[:, :1, :, :1]).all(), "each pixel of the sensor is an even area"


def test_each_image_is_given_once_and_the_latest_at_any_time() -> None:
    touch = camera("sim-rigid")
    with pytest.raises(DeviceNotConnectedError):
        touch.async_read()
    touch.connect()
    try:
        assert (touch.width, touch.height) == (64, 128)
        with pytest.raises(DeviceAlreadyConnectedError):
            touch.connect()
        first = touch.async_read(timeout_ms=2000)
        with pytest.raises(TimeoutError):
            touch.async_read(timeout_ms=1)
        assert touch.read_latest() is first
        assert touch.read() is not first
    finally:
        touch.disconnect()
    assert not touch.is_connected
    with pytest.raises(DeviceNotConnectedError):
        touch.read_latest()


def test_option_of_the_page_makes_a_camera_for_a_robot() -> None:
    found = re.search(r'--robot\.cameras="(.*)"', PAGE.read_text(encoding="utf-8"))
    configs = draccus.parse(Cameras, args=[f"--cameras={found[1]}"]).cameras
    touch = configs["touch"]
    # LeRobot's robots refuse a camera without any of them.
    assert None not in (touch.width, touch.height, touch.fps)
    assert make_cameras_from_configs(configs)["touch"].fps == touch.fps


def test_a_simulated_sensor_is_called_so(caplog: pytest.LogCaptureFixture) -> None:
    with camera("sim-rigid"):
        assert "SIMULATED" in caplog.text


def test_a_size_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="width 64, height 128"):
        camera("sim-rigid", width=63).connect()


def test_a_board_without_calibration_is_seen_from_its_first_second_on(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    with run_on_port(partial(run_board, rate_hz=100.0)) as (port, process):
        rig.write_text(
            '[array]\nopen = "palpate.sensor.board_array:open_board"\n'
            f'port = "{port}"\nrate_hz = 100.0\n'
        )
        with camera(str(rig)) as touch:
            assert touch.read().shape == (128, 64, 3)
            assert touch.read_latest().max() < 20
            os.kill(process, signal.SIGSTOP)
            # What was on its way still comes.
            with pytest.raises(TimeoutError, match="palpate doctor"):
                deque((touch.async_read(timeout_ms=300) for _ in range(200)), maxlen=0)
