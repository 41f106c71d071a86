"""The camera on the twin and on a board, through LeRobot's own registry and factory."""

from __future__ import annotations

import os
import re
import signal
from collections import deque
from contextlib import suppress
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
    """The part of a robot's configuration that is on the page."""

    cameras: dict[str, CameraConfig]


def camera(rig: str, **settings: object):  # type: ignore[no-untyped-def]
    """Create the camera like a LeRobot robot, from the name of its type."""
    config = CameraConfig.get_choice_class("palpate")(rig=rig, **settings)
    assert config.type == "palpate"
    return make_cameras_from_configs({"touch": config})["touch"]


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    """Return images of the twin, at 250 per second, until its object is squeezed."""
    found: list[np.ndarray] = []
    with camera("sim-rigid", width=8, height=16) as touch:
        while len(found) < 10_000 and (not found or found[-1].max() < 80):
            found.append(touch.async_read(timeout_ms=2000))
    return found


def test_images_have_requested_size(images: list[np.ndarray]) -> None:
    assert {one.shape for one in images} == {(16, 8, 3)}
    assert {one.dtype for one in images} == {np.dtype(np.uint8)}


def test_squeeze_brightens_dark_image(images: list[np.ndarray]) -> None:
    assert images[0].max() < 20
    assert images[-1].max() >= 80
    assert all(np.array_equal(one[..., 0], one[..., 2]) for one in images), "grey"
    blocks = images[-1][..., 0].reshape(4, 4, 2, 4)
    assert (blocks == blocks[:, :1, :, :1]).all(), "each pixel of the sensor is a uniform area"


def test_async_read_returns_each_image_once_and_read_latest_anytime() -> None:
    touch = camera("sim-rigid")
    with pytest.raises(DeviceNotConnectedError):
        touch.async_read()
    touch.connect()
    try:
        assert (touch.width, touch.height) == (64, 128)
        with pytest.raises(DeviceAlreadyConnectedError):
            touch.connect()
        images = [touch.async_read(timeout_ms=2000)]
        # A frame may arrive between two reads, but not between all of them.
        with suppress(TimeoutError):
            while len(images) < 1000:
                images.append(touch.async_read(timeout_ms=0))
        assert len(images) < 1000
        assert len({id(one) for one in images}) == len(images)
        assert touch.read_latest().shape == touch.read().shape == images[0].shape
    finally:
        touch.disconnect()
    assert not touch.is_connected
    with pytest.raises(DeviceNotConnectedError):
        touch.read_latest()


def test_option_on_page_configures_camera_for_robot() -> None:
    found = re.search(r'--robot\.cameras="(.*)"', PAGE.read_text(encoding="utf-8"))
    configs = draccus.parse(Cameras, args=[f"--cameras={found[1]}"]).cameras
    touch = configs["touch"]
    # LeRobot's robots refuse a camera without all three.
    assert None not in (touch.width, touch.height, touch.fps)
    assert make_cameras_from_configs(configs)["touch"].fps == touch.fps


def test_simulated_sensor_logs_simulated(caplog: pytest.LogCaptureFixture) -> None:
    with camera("sim-rigid"):
        assert "SIMULATED" in caplog.text


def test_connect_with_unsuitable_size_is_refused() -> None:
    with pytest.raises(ValueError, match="width 64, height 128"):
        camera("sim-rigid", width=63).connect()


def test_board_without_calibration_uses_first_second_as_rest(tmp_path: Path) -> None:
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
            # Frames already sent still arrive.
            with pytest.raises(TimeoutError, match="palpate doctor"):
                deque((touch.async_read(timeout_ms=300) for _ in range(200)), maxlen=0)
