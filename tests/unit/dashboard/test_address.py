"""The address for others, and its QR code, read by a reader of codes."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

import numpy as np
import pytest
import zxingcpp

from palpate.dashboard.address import address_for_others, qr_text


@pytest.mark.parametrize(("host", "family"), [("0.0.0.0", socket.AF_INET), ("::", socket.AF_INET6)])
def test_what_listens_everywhere_can_be_reached_where_it_says(
    host: str, family: socket.AddressFamily
) -> None:
    with socket.socket(family) as listening:
        listening.bind((host, 0))
        listening.listen()
        parts = urlsplit(address_for_others(host, listening.getsockname()[1]))
        assert parts.hostname not in ("0.0.0.0", "::", None)
        with socket.create_connection((parts.hostname, parts.port), timeout=10):
            pass


def test_the_code_in_a_terminal_is_read_as_the_address() -> None:
    address = "http://192.0.2.7:8080/"
    #: Each character is two modules, one over the other; a terminal is dark.
    halves = {" ": (0, 0), "\u2580": (255, 0), "\u2584": (0, 255), "\u2588": (255, 255)}
    lines = [line for line in qr_text(address).splitlines() if line]
    pairs = np.array([[halves[char] for char in line] for line in lines], dtype=np.uint8)
    modules = pairs.transpose(0, 2, 1).reshape(-1, pairs.shape[1])
    (read,) = zxingcpp.read_barcodes(np.kron(modules, np.ones((8, 8), dtype=np.uint8)))
    assert read.text == address
