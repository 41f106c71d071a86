"""Latency and loss of the ROS 2 bridge: simulated 250 Hz frames over DDS.

After `source VENV/bin/ros.sh`: `python ros2/benchmarks/latency.py --seconds 600 [--reliable]`. The
stamp of a frame is the time at which it was passed to the node, on the clock of the same machine.
The latency is the time from the stamp to the subscriber's callback. Lost frames were sent but not
received.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time

import numpy as np
import rclpy
from palpate_ros.topics import Provenance, SensorTopics
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image

from palpate.recording import RecordingInfo
from palpate.rig.recorded import clock_zero_unix_ns
from palpate.sensor.array import RIGID_LAYOUT, Frame

RATE_HZ = 250.0


def publish(seconds: float) -> None:
    """Publish frames at the rate; print their number and the processor time."""
    rclpy.init()
    node = Node("bench_sensor")
    info = RecordingInfo(
        layout=RIGID_LAYOUT, origin="twin", clock_zero_unix_ns=clock_zero_unix_ns()
    )
    about = Provenance(info=info, calibration=None, oversampling=1, frame_id="pad")
    topics = SensorTopics(node, about)
    counts = np.random.default_rng(1).integers(200, 400, (64, 4, 2))
    while not node.count_subscribers("/bench_sensor/counts"):
        time.sleep(0.1)
    time.sleep(1.0)
    start_s, cpu_s = time.monotonic(), time.process_time()
    total = int(seconds * RATE_HZ)
    for number in range(total):
        wait_s = start_s + number / RATE_HZ - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        now_s = time.monotonic()
        topics.publish(Frame(time_s=now_s, sequence=number, counts=counts[number % 64]))
    took_s = time.monotonic() - start_s
    cpu_percent = 100 * (time.process_time() - cpu_s) / took_s
    print(json.dumps({"sent": total, "took_s": took_s, "cpu_percent": cpu_percent}), flush=True)
    time.sleep(1.0)
    rclpy.shutdown()


def main() -> None:
    """Subscribe, count, and print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--reliable", action="store_true", help="request reliable delivery")
    parser.add_argument("--publish", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        publish(options.seconds)
        return
    rclpy.init()
    node, delays_s = Node("bench_client"), []

    def receive(message: Image) -> None:
        stamp = message.header.stamp
        delays_s.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)

    qos = QoSProfile(depth=250) if options.reliable else qos_profile_sensor_data
    node.create_subscription(Image, "/bench_sensor/counts", receive, qos)
    command = [sys.executable, __file__, "--publish", "--seconds", str(options.seconds)]
    sender = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ})
    while sender.poll() is None:
        rclpy.spin_once(node, timeout_sec=0.1)
    assert sender.stdout is not None
    sent = json.loads(sender.stdout.read())
    p50, p99, worst = (1e3 * float(np.quantile(delays_s, q)) for q in (0.5, 0.99, 1.0))
    lost = sent["sent"] - len(delays_s)
    print(
        json.dumps(
            {
                "frames": sent["sent"],
                "rate_hz": round(sent["sent"] / sent["took_s"], 1),
                "lost": lost,
                "p50_ms": round(p50, 2),
                "p99_ms": round(p99, 2),
                "worst_ms": round(worst, 1),
                "sender_cpu_percent": round(sent["cpu_percent"], 1),
                "load_average": os.getloadavg()[0],
            }
        )
    )


if __name__ == "__main__":
    main()
