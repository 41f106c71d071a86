"""Users of a station with tokens and roles, and their file."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from palpate.errors import InputError

_MIN_TOKEN_LENGTH = 8


class Role(StrEnum):
    """What a user may do; each role includes the ones before it."""

    #: Watch, and stop.
    VIEW = "view"
    #: Grasp, release, label.
    OPERATE = "operate"
    #: Open rigs, calibrate, replay, rename and delete recordings.
    CONFIGURE = "configure"

    @property
    def may_drive(self) -> bool:
        """Whether the role may move the hand."""
        return self is not Role.VIEW


@dataclass(frozen=True, slots=True, kw_only=True)
class User:
    """A user; the one of `--token` has no name and may do everything."""

    token: str
    name: str = ""
    role: Role = Role.CONFIGURE


def read_users(path: Path) -> tuple[User, ...]:
    """Read a file of users (TOML): a section with `token` and `role` for each name.

    Raises `InputError` if the file can't be read or is readable by others, or if a token is short
    or occurs twice.
    """
    try:
        with path.open("rb") as stream:
            sections = tomllib.loads(stream.read().decode("utf-8-sig"))
            is_open = os.fstat(stream.fileno()).st_mode & 0o077
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--users {path}: {why}") from error
    if is_open:
        raise InputError(f"--users {path}: other users can read it; run `chmod 600 {path}`")
    users = tuple(
        _read_user(f"--users {path}: {name}", name, one) for name, one in sections.items()
    )
    if not users:
        raise InputError(f"--users {path}: no user; add a section such as [maria]")
    if len({user.token for user in users}) < len(users):
        raise InputError(f"--users {path}: two users have the same token; give each one of its own")
    return users


def _read_user(where: str, name: str, section: object) -> User:
    if not isinstance(section, dict) or section.keys() != {"token", "role"}:
        raise InputError(f"{where}: must be a section with the keys token and role")
    token, role = section["token"], section["role"]
    if role not in [str(one) for one in Role]:
        raise InputError(f"{where}: role {role!r}: must be one of {', '.join(Role)}")
    if not isinstance(token, str) or len(token) < _MIN_TOKEN_LENGTH:
        raise InputError(f"{where}: the token must have at least {_MIN_TOKEN_LENGTH} characters")
    return User(name=name, token=token, role=Role(role))
