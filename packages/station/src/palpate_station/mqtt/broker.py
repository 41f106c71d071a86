"""Read the broker file: address, topic, credentials and certificates."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from ipaddress import ip_address
from pathlib import Path

from palpate.errors import InputError
from palpate.files import load_dataclass

#: A part of a host name (RFC 1123), with the underscore of many local networks, and the longest
#: name.
_HOST_LABEL = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")
_LONGEST_HOST = 253
#: Environment variable with the password, used if the file has no password.
PASSWORD_VARIABLE = "PALPATE_MQTT_PASSWORD"
#: The parts of a topic share the 65 535 bytes of MQTT with the names of the messages; brokers limit
#: them further (Amazon's to 256 bytes, Azure's to 128 letters).
LONGEST_TEXT_BYTES = 1024
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """The settings of a broker file."""

    #: Host name or IP address.
    host: str
    #: Prefix of every topic of this station, such as ``"palpate/line-1"``.
    topic: str
    #: TCP port; None for 8883 with TLS and 1883 without.
    port: int | None = None
    #: Whether to encrypt. A password requires TLS, except to a broker on this machine.
    tls: bool = True
    #: CA certificate that verifies the broker; None for the system's CA store.
    ca: str | None = None
    #: Client certificate and key of this station, if the broker requires them.
    certificate: str | None = None
    key: str | None = None
    #: Username of this station.
    username: str | None = None
    #: Password, by default from `PALPATE_MQTT_PASSWORD`. A file with a password must be readable
    #: only by its owner.
    password: str | None = None

    @property
    def effective_port(self) -> int:
        """The configured port, or the default port for TLS or plain MQTT."""
        return self.port or (8883 if self.tls else 1883)


def read_broker(path: Path, *, environment: Mapping[str, str] = os.environ) -> Broker:
    """Read a broker file (TOML); its paths are relative to the file's folder.

    Raises `InputError` if the file can't be read, if a name or value is invalid, or if the password
    is readable by other users or would be sent unencrypted.
    """
    try:
        with path.open("rb") as stream:
            stated = tomllib.loads(stream.read().decode("utf-8-sig"))
            broker = load_dataclass(Broker, stated)
            readable = os.fstat(stream.fileno()).st_mode & 0o077
    except (OSError, ValueError, RecursionError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--mqtt {path}: {why}") from error
    if broker.password is not None and readable:
        raise InputError(
            f"--mqtt {path}: other users can read the password; run `chmod 600 {path}`"
        )
    if not _is_host(broker.host):
        raise InputError(
            f"--mqtt {path}: host {broker.host!r:.60} is not a valid host name or IP address; "
            'write the name alone, e.g. "broker.local" (`port` and `tls` are keys of their own)'
        )
    if broker.port is not None and not 1 <= broker.port <= 65535:
        raise InputError(f"--mqtt {path}: port {broker.port} is not between 1 and 65535")
    topic = broker.topic
    if not topic.isprintable() or not topic or any(sign in topic for sign in "#+$"):
        raise InputError(
            f"--mqtt {path}: topic {topic!r:.60} is empty or contains #, +, $ or NUL, which MQTT "
            "reserves, or another invisible character"
        )
    for name in ("topic", "username", "password"):
        size = len((getattr(broker, name) or "").encode())
        if size > LONGEST_TEXT_BYTES:
            raise InputError(
                f"--mqtt {path}: {name} has {size} bytes; at most {LONGEST_TEXT_BYTES} are possible"
            )
    if broker.key is not None and broker.certificate is None:
        raise InputError(f"--mqtt {path}: key needs `certificate` too")
    broker = replace(broker, password=broker.password or environment.get(PASSWORD_VARIABLE))
    if broker.password is not None and not broker.tls and broker.host not in _LOOPBACK:
        raise InputError(
            f"--mqtt {path}: sending a password to {broker.host} requires TLS; set `tls = true`"
        )
    return replace(
        broker,
        ca=_resolve_path(path, broker.ca),
        certificate=_resolve_path(path, broker.certificate),
        key=_resolve_path(path, broker.key),
    )


def _is_host(host: str) -> bool:
    try:
        return bool(ip_address(host))
    except ValueError:
        pass
    try:
        labels = host.encode("idna").decode().removesuffix(".").split(".")
    except UnicodeError:  # a label is empty or too long
        return False
    # A number at the end is an IP address with a mistake.
    is_name = all(map(_HOST_LABEL.fullmatch, labels)) and not labels[-1].isdigit()
    return is_name and len(host) <= _LONGEST_HOST


def _resolve_path(path: Path, name: str | None) -> str | None:
    if name is None:
        return None
    file = path.parent / name
    if not file.is_file():
        raise InputError(f"--mqtt {path}: file {file} does not exist")
    return str(file)
