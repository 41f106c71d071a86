"""Where others can open the pages, as an address and as a QR code."""

from __future__ import annotations

import io
import socket
from ipaddress import ip_address

import segno

#: Addresses for documentation (RFC 5737, RFC 3849): the route to them leaves this machine.
_ELSEWHERE = {socket.AF_INET: "198.51.100.1", socket.AF_INET6: "2001:db8::1"}
#: Free modules around the code; readers want four, and the dark screen of a terminal is no border.
_MARGIN = 4


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


def qr_text(address: str) -> str:
    """Return an address as a QR code of characters, for a terminal."""
    out = io.StringIO()
    segno.make(address, micro=False).terminal(out=out, border=_MARGIN, compact=True)
    return out.getvalue()


def qr_svg(address: str) -> str:
    """Return an address as a QR code: an SVG picture, dark on light whatever the page is."""
    code = segno.make(address, micro=False)
    return str(code.svg_inline(border=_MARGIN, omitsize=True, dark="#000", light="#fff"))
