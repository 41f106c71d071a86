"""The broker's file: its address, topic, and the means to verify its identity."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files import structure

#: Environment variable that holds the password, where the file has none.
PASSWORD_VARIABLE = "PALPATE_MQTT_PASSWORD"
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """A broker, as its file describes it."""

    #: Name or address.
    host: str
    #: What every topic of this station begins with: ``"palpate/line-1"``.
    topic: str
    #: None: 8883 with TLS, 1883 without.
    port: int | None = None
    #: Whether to encrypt. Only a broker on this machine may do without when there is a password.
    tls: bool = True
    #: File of the authority that signed the broker's certificate; None: those of the system.
    ca: str | None = None
    #: Files of this station's own certificate and key, where the broker asks for them.
    certificate: str | None = None
    key: str | None = None
    #: Who this station is.
    username: str | None = None
    #: Better kept in `PALPATE_MQTT_PASSWORD`, or in a file that only its owner can read.
    password: str | None = None

    @property
    def port_or_usual(self) -> int:
        """The port."""
        return self.port or (8883 if self.tls else 1883)


def read_broker(path: Path, *, environment: Mapping[str, str] = os.environ) -> Broker:
    """Read a broker's file (TOML); paths in it are relative to it.

    Raises `InputError` if it can't be read, a name or value in it is wrong, its password could be
    read by others or would travel in the clear.
    """
    try:
        with path.open("rb") as stream:
            broker = structure(Broker, tomllib.load(stream))
            readable = os.fstat(stream.fileno()).st_mode & 0o077
    except (OSError, tomllib.TOMLDecodeError, InputError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--mqtt {path}: {why}") from error
    if broker.password is not None and readable:
        raise InputError(f"--mqtt {path}: others can read its password; run `chmod 600 {path}`")
    if not _is_host(broker.host):
        raise InputError(f"--mqtt {path}: host {broker.host!r} is no name or address")
    if broker.port is not None and not 1 <= broker.port <= 65535:
        raise InputError(f"--mqtt {path}: port {broker.port} is not 1 to 65535")
    if not broker.topic or any(sign in broker.topic for sign in "#+$\0"):
        raise InputError(f"--mqtt {path}: topic {broker.topic!r} can't be published to")
    broker = replace(broker, password=broker.password or environment.get(PASSWORD_VARIABLE))
    if broker.password is not None and not broker.tls and broker.host not in _LOOPBACK:
        raise InputError(f"--mqtt {path}: a password needs TLS on the way to {broker.host}")
    return replace(
        broker,
        ca=_resolve_path(path, broker.ca),
        certificate=_resolve_path(path, broker.certificate),
        key=_resolve_path(path, broker.key),
    )


def _is_host(host: str) -> bool:
    try:
        return bool(host.encode("idna")) and host.isprintable() and " " not in host
    except UnicodeError:  # a part that is empty or too long
        return False


def _resolve_path(path: Path, name: str | None) -> str | None:
    if name is None:
        return None
    file = path.parent / name
    if not file.is_file():
        raise InputError(f"--mqtt {path}: there is no file {file}")
    return str(file)
