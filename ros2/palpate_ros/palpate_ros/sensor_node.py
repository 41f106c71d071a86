"""`ros2 run palpate_ros sensor`: a sensor without a hand, as a lifecycle node."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from palpate import __version__
from palpate.calibration import Calibration
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.errors import DeviceError, DeviceTimeoutError, PalpateError
from palpate.recording import RecordingInfo
from palpate.rig.paced_array import PacedArray
from palpate.rig.recorded import clock_zero_unix_ns, firmware_version
from palpate.sensor.array import PressureArray
from palpate_ros.parameters import SHARED, declare
from palpate_ros.spinning import run
from palpate_ros.topics import Provenance, SensorTopics

_FRAME_S, _RETRY_S, _DIAGNOSE_S = 0.5, 0.5, 1.0


class SensorNode(LifecycleNode):
    """A lifecycle node that opens the sensor when configured and publishes while active.

    By default (`autostart`) the node configures and activates itself.
    """

    def __init__(self) -> None:
        super().__init__("palpate_sensor")
        declare(
            self,
            SHARED | {"autostart": (True, "Configure and activate without a lifecycle manager.")},
        )
        self._source: SensorSource | None = None
        self._topics: SensorTopics | None = None
        self._timer = None
        self._reader: threading.Thread | None = None
        self._active, self._ending = threading.Event(), threading.Event()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the sensor; a fault is logged in one line and leaves the node unconfigured."""
        name = str(self.get_parameter("rig").value)
        try:
            self._source = source = open_source(rig=name)
            array: PressureArray = source.array
            if source.simulated:
                array = PacedArray(array, speed=float(self.get_parameter("speed").value))
            first = array.read(timeout_s=2.0)
            info = RecordingInfo(
                layout=array.layout,
                origin="twin" if source.simulated else "hardware",
                rig=name,
                firmware_version=firmware_version(source.array),
                versions={"palpate": __version__},
                clock_zero_unix_ns=(
                    time.time_ns() - round(first.time_s * 1e9)
                    if source.simulated
                    else clock_zero_unix_ns()
                ),
            )
            calibration = _calibration(source)
        except PalpateError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        if calibration is not None:
            info = replace(info, calibration=calibration.as_text())
        self._topics = SensorTopics(
            self,
            Provenance(
                info=info,
                calibration=calibration,
                oversampling=first.oversampling,
                frame_id=str(self.get_parameter("frame_id").value),
            ),
        )
        self._timer = self.create_timer(_DIAGNOSE_S, self._topics.diagnose)
        self._ending.clear()
        self._reader = threading.Thread(target=self._read, args=(array,), daemon=True)
        self._reader.start()
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start publishing."""
        self._active.set()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop publishing; reading continues."""
        self._active.clear()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the sensor."""
        self.shut_down()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the sensor."""
        self.shut_down()
        return TransitionCallbackReturn.SUCCESS

    def shut_down(self) -> None:
        """Stop reading and close the sensor; further calls have no effect."""
        self._active.clear()
        self._ending.set()
        if self._reader is not None:
            self._reader.join()
        if self._timer is not None:
            self.destroy_timer(self._timer)
        if self._topics is not None:
            self._topics.close()
        if self._source is not None:
            self._source.close()
        self._reader = self._timer = self._topics = self._source = None

    def _read(self, array: PressureArray) -> None:
        topics = self._topics
        assert topics is not None
        while not self._ending.is_set():
            try:
                frame = array.read(timeout_s=_FRAME_S)
            except DeviceTimeoutError as error:
                topics.fail(str(error))
                continue
            except DeviceError as error:
                topics.fail(str(error))
                self._ending.wait(_RETRY_S)
                continue
            if self._active.is_set():
                topics.publish(frame)


def _calibration(source: SensorSource) -> Calibration | None:
    """Return the calibration, checked against the sensor; None without one."""
    source.rest_ohm()
    path = source.calibration_path
    if source.calibration is None and path is not None and path.exists():
        return Calibration.load(path)
    return source.calibration


def _start_node() -> SensorNode:
    node = SensorNode()
    if node.get_parameter("autostart").value:
        if node.trigger_configure() is not TransitionCallbackReturn.SUCCESS:
            raise DeviceError("the sensor could not be opened; see the log line above")
        node.trigger_activate()
    return node


def main() -> None:
    """Run the node until Ctrl-C."""
    run(_start_node, name="palpate_sensor")


if __name__ == "__main__":
    main()
