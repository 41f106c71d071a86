"""The external URL of the server."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

import pytest

from palpate.dashboard.transport import external_url


@pytest.mark.parametrize(("host", "family"), [("0.0.0.0", socket.AF_INET), ("::", socket.AF_INET6)])
def test_external_url_of_a_wildcard_host_accepts_connections(
    host: str, family: socket.AddressFamily
) -> None:
    with socket.socket(family) as listening:
        listening.bind((host, 0))
        listening.listen()
        parts = urlsplit(external_url(host, listening.getsockname()[1]))
        assert parts.hostname not in ("0.0.0.0", "::", None)
        with socket.create_connection((parts.hostname, parts.port), timeout=10):
            pass
