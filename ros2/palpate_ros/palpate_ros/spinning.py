"""Run a node until Ctrl-C or SIGTERM; devices are made safe before ROS shuts down."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Protocol

import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from palpate.errors import PalpateError


class Owner(Protocol):
    """A node that owns devices."""

    def shut_down(self) -> None:
        """Make the devices safe and close them."""
        ...


def run(make: Callable[[], Owner], *, name: str) -> None:
    """Create a node and spin it until a signal; then close the devices and ROS."""
    # ROS's own signal handlers would shut ROS down before the devices are safe.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = make()
    except PalpateError as error:
        rclpy.logging.get_logger(name).error(str(error))
        rclpy.try_shutdown()
        raise SystemExit(error.exit_status) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    executor = MultiThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    try:
        ended.wait()
    finally:
        node.shut_down()
        executor.shutdown()
        spinning.join()
        node.destroy_node()
        rclpy.try_shutdown()
