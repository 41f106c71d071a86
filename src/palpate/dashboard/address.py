"""The address at which others can open the pages."""

from __future__ import annotations

import socket
from ipaddress import ip_address

#: Addresses for documentation (RFC 5737, RFC 3849): the route to them leaves this machine.
_ELSEWHERE = {socket.AF_INET: "198.51.100.1", socket.AF_INET6: "2001:db8::1"}


def address_for_others(host: str, port: int) -> str:
    """Return the address that others can open, of a server that listens at a host.

    One that listens everywhere (``0.0.0.0``, ``::``) is found at the address of the network that
    this machine would send by; without any network, on this machine.

    Examples
    --------
    >>> address_for_others("robot.local", 8080)
    'http://robot.local:8080/'
    >>> address_for_others("::1", 8080)
    'http://[::1]:8080/'
    """
    try:
        everywhere = ip_address(host).is_unspecified
    except ValueError:
        everywhere = False
    if everywhere:
        host = _own_address(socket.AF_INET6 if ":" in host else socket.AF_INET)
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/"


def _own_address(family: socket.AddressFamily) -> str:
    # Connecting a datagram socket sends nothing: it looks up the route.
    with socket.socket(family, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect((_ELSEWHERE[family], 9))
        except OSError:
            return "::1" if family is socket.AF_INET6 else "127.0.0.1"
        return str(asking.getsockname()[0])
