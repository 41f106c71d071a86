"""The camera: a thread reads the sensor and provides the newest image."""

from __future__ import annotations

import logging
import threading
from contextlib import closing
from typing import Any

import numpy as np
from lerobot.cameras import Camera
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from numpy.typing import NDArray

from lerobot_camera_palpate.config import PalpateCameraConfig
from lerobot_camera_palpate.image import render_image
from palpate.cli.live_reading import LiveReading, pace_frames
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.clock import RealClock
from palpate.errors import PalpateError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.ports import list_serial_ports

_PIXEL_SIZE = 32
#: Timeout of the first image; without a calibration the first second is used as rest.
_FIRST_S = 5.0


class PalpateCamera(Camera):
    """A pressure sensor that implements LeRobot's camera interface.

    Parameters
    ----------
    config : PalpateCameraConfig
        The rig and the size of the image.
    """

    def __init__(self, config: PalpateCameraConfig) -> None:
        super().__init__(config)
        self.width: int | None = config.width
        self.height: int | None = config.height
        self._rig = config.rig
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        #: Guards the attributes below; notified by every image and by the end.
        self._news = threading.Condition()
        self._image: NDArray[np.uint8] | None = None
        self._taken_s = 0.0
        self._unread = False
        self._failure: PalpateError | None = None

    @property
    def is_connected(self) -> bool:
        """Whether the sensor is being read."""
        return self._thread is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return the serial ports that look like a board."""
        return [
            {"name": port.board, "type": "palpate", "id": port.device}
            for port in list_serial_ports()
            if port.board is not None
        ]

    def connect(self, warmup: bool = True) -> None:
        """Open the rig and start reading it.

        Parameters
        ----------
        warmup : bool
            Wait for the first image.

        Raises
        ------
        PalpateError
            If the rig can't be opened or its sensor is gone.
        ValueError
            If the size of the image does not fit the sensor.
        TimeoutError
            If no image arrives in time.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        source = open_source(rig=self._rig)
        try:
            self._choose_size(source.array.layout)
            reading = LiveReading(source, rest_ohm=source.rest_ohm(), clock=RealClock())
        except BaseException:
            source.close()
            raise
        if source.simulated:
            logging.getLogger(__name__).warning("%s is SIMULATED: the twin is squeezed", self)
        self._ended.clear()
        self._image, self._failure, self._unread = None, None, False
        self._thread = threading.Thread(
            target=self._read_frames, args=(source, reading), daemon=True
        )
        self._thread.start()
        if warmup:
            try:
                self.async_read(timeout_ms=1e3 * _FIRST_S)
            except BaseException:
                self.disconnect()
                raise

    def read(self) -> NDArray[Any]:
        """Return the next image."""
        with self._news:
            self._unread = False
        return self.async_read(timeout_ms=1e3 * _FIRST_S)

    def async_read(self, timeout_ms: float = 200) -> NDArray[Any]:
        """Return the newest unread image; wait for one if necessary.

        Raises
        ------
        TimeoutError
            If no image arrives in time.
        DeviceNotConnectedError
            If the camera is not connected.
        PalpateError
            If the sensor is gone.
        """
        self._require_connection()
        with self._news:
            has_news = self._news.wait_for(
                lambda: self._unread or self._failure is not None, timeout=timeout_ms / 1e3
            )
            if self._failure is not None:
                raise self._failure
            if not has_news or self._image is None:
                raise TimeoutError(f"{self}: no frame in {timeout_ms:g} ms; run `palpate doctor`")
            self._unread = False
            return self._image

    def read_latest(self, max_age_ms: int = 500) -> NDArray[Any]:
        """Return the newest image immediately.

        Raises
        ------
        TimeoutError
            If the newest image is older than `max_age_ms`.
        RuntimeError
            If there is no image yet.
        DeviceNotConnectedError
            If the camera is not connected.
        PalpateError
            If the sensor is gone.
        """
        self._require_connection()
        with self._news:
            if self._failure is not None:
                raise self._failure
            if self._image is None:
                raise RuntimeError(f"{self}: no frame yet")
            age_ms = 1e3 * (RealClock().now_s() - self._taken_s)
            if age_ms > max_age_ms:
                raise TimeoutError(f"{self}: the newest frame is {age_ms:.0f} ms old")
            return self._image

    def disconnect(self) -> None:
        """Stop reading, and close the rig."""
        self._require_connection()
        assert self._thread is not None
        self._ended.set()
        self._thread.join()
        self._thread = None

    def __str__(self) -> str:
        return f"PalpateCamera({self._rig})"

    def _require_connection(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect() first")

    def _choose_size(self, layout: ArrayLayout) -> None:
        """Set the size of the image.

        Raises
        ------
        ValueError
            If the size is not a multiple of the sensor's.
        """
        width, height = (
            self.width or _PIXEL_SIZE * layout.cols,
            self.height or (_PIXEL_SIZE * layout.rows),
        )
        if width % layout.cols or height % layout.rows:
            raise ValueError(
                f"{self}: {width} x {height} does not fit {layout.cols} x {layout.rows} pixels; "
                f"choose multiples, like width {_PIXEL_SIZE * layout.cols}, "
                f"height {_PIXEL_SIZE * layout.rows}"
            )
        self.width, self.height = width, height

    def _read_frames(self, source: SensorSource, reading: LiveReading) -> None:
        """Read frames until the end, in the thread."""
        clock = RealClock()
        with closing(source):
            try:
                for frame in pace_frames(source):
                    if self._ended.is_set():
                        return
                    if frame is not None:
                        reading.add(frame)
                        self._store_image(reading, now_s=clock.now_s())
            except PalpateError as error:
                with self._news:
                    self._failure = error
                    self._news.notify_all()

    def _store_image(self, reading: LiveReading, *, now_s: float) -> None:
        if reading.change_percent is None:
            return
        assert self.width is not None
        assert self.height is not None
        image = render_image(reading.change_percent, width=self.width, height=self.height)
        # Callers may keep the image, so it must not change.
        image.flags.writeable = False
        with self._news:
            self._image, self._taken_s, self._unread = image, now_s, True
            self._news.notify_all()
