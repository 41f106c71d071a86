"""The error tree.

Every message is one line that states what, where and what to do.

World outcomes (a slip, a hold that is too short) are statuses on results; only bad input and broken
equipment raise. `exit_status` is what the command line returns for the error.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class PalpateError(Exception):
    """Root of every error that palpate raises on purpose."""

    exit_status = 2


class InputError(PalpateError, ValueError):
    """A file, option or argument that can't be used as given."""


class CalibrationError(PalpateError):
    """Calibration data that are refused, or a calibration file that doesn't fit."""


class RecordingError(PalpateError):
    """A recording that can't be read or written."""


class RecordingLostError(RecordingError):
    """A recording that can't be written any more: disk full, medium gone."""

    exit_status = 3


class MissingExtraError(PalpateError):
    """An optional dependency is not installed; the message names the extra to install."""


class DeviceError(PalpateError):
    """Equipment that is lost, refused or broken."""

    exit_status = 3


class DeviceNotFoundError(DeviceError):
    """No such port, board or servo."""


class DeviceTimeoutError(DeviceError, TimeoutError):
    """Equipment that stopped answering."""


class WireError(DeviceError):
    """Bytes that break the protocol in a way that can't be skipped over."""


class StoreError(PalpateError):
    """A store of items that can't be used: not a store, read-only, newer or damaged."""


class StoreAwayError(StoreError):
    """A store that does not answer: no server, locked, disk full.

    A later attempt may succeed.
    """

    exit_status = 3


@contextmanager
def require_extra(what: str, *, extra: str) -> Iterator[None]:
    """Import within what an extra brings; where it is missing, explain how to install it.

    Raises
    ------
    MissingExtraError
        If a module is not installed.

    Examples
    --------
    >>> with require_extra("a telepathic gripper", extra="all"):
    ...     import telepathy
    Traceback (most recent call last):
    palpate.errors.MissingExtraError: a telepathic gripper needs telepathy; install it with \
`pip install 'palpate[all]'`
    """
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(
            f"{what} needs {error.name}; install it with `pip install 'palpate[{extra}]'`"
        ) from error
