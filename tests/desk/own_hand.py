"""A gripper's driver as its owner wrote it: lines of text over a serial port.

The hand knows ``get`` (answer: the width in mm) and ``set WIDTH SPEED`` (answer: ``ok``).
"""

import time

import serial

from palpate.errors import DeviceError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState


class OwnHand:
    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)

    def __init__(self, port):
        self.port = serial.Serial(port, 115200, timeout=0.2)
        self.target = self.last = self.ask("get")
        self.moved_s = 0.0

    def ask(self, line):
        self.port.write(line.encode() + b"\n")
        answer = self.port.readline()
        if not answer.endswith(b"\n"):
            raise DeviceError(f"{self.port.name}: the hand does not answer; check its cable")
        return float(answer) if line == "get" else None

    def state(self):
        width, now_s = self.ask("get"), time.monotonic()
        if abs(width - self.last) > 0.02:
            self.last, self.moved_s = width, now_s
        return GripperState(time_s=now_s, width_mm=width, moving=now_s - self.moved_s < 0.1)

    def command(self, wanted):
        sent = self.limits.clamp(wanted)
        self.ask(f"set {sent.target:.3f} {sent.rate:.3f}")
        self.target, self.moved_s = sent.target, time.monotonic()
        return sent

    def stop(self):
        width = self.ask("get")
        self.command(GripperCommand(target=width, rate=self.limits.fastest))

    def release(self):
        self.command(GripperCommand(target=self.limits.highest, rate=self.limits.fastest))

    def close(self):
        self.port.close()


def open_hand(*, port: str):
    return OwnHand(port)
