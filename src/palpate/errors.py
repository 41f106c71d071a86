"""The exceptions of palpate.

Every message is one line that states the fault, its place and a remedy. Outcomes in the physical
world (a slip, a hold that is too short) are statuses of results; only invalid input and broken
equipment raise. `exit_status` is the exit status of the command line for an error.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

#: Failures of a disk, which another argument would not remedy.
DISK_FAILURES = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


class PalpateError(Exception):
    """Base class of the exceptions that palpate raises intentionally."""

    exit_status = 2


class InputError(PalpateError, ValueError):
    """An invalid file, option or argument."""


class CalibrationError(PalpateError):
    """Unusable calibration data, or a calibration file that doesn't match the rig."""


class NoiseError(CalibrationError):
    """Readings whose noise hides whether the sensor is at rest."""


class RecordingError(PalpateError):
    """A recording that can't be read or written."""


class RecordingLostError(RecordingError):
    """A running recording that can't be continued, such as on a full disk."""

    exit_status = 3


class DamageWarning(UserWarning):
    """A recording that is incomplete, damaged or can't be checked, but still readable."""


class MissingExtraError(PalpateError):
    """A missing optional dependency; the message names the extra to install."""


class DeviceError(PalpateError):
    """Equipment that is lost, inaccessible or broken."""

    exit_status = 3


class DeviceNotFoundError(DeviceError):
    """A port, board or servo that doesn't exist."""


class DeviceTimeoutError(DeviceError, TimeoutError):
    """Equipment that does not answer in time."""


class WireError(DeviceError):
    """Bytes without a valid packet or frame, or a command that the board refuses."""


class StoreError(PalpateError):
    """An unusable store of items: not a store, read-only, too new or damaged."""


class StoreMissingError(StoreError):
    """A store whose file does not exist yet."""


class StoreAwayError(StoreError):
    """A temporarily unavailable store: no server, locked or disk full."""

    exit_status = 3


@contextmanager
def require_extra(what: str, *, extra: str, package: str = "palpate") -> Iterator[None]:
    """Translate a failed import of an extra's module into an error with install instructions.

    Raises
    ------
    MissingExtraError
        If a module imported in the block is not installed.

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
            f"{what} needs {error.name}; install it with `pip install '{package}[{extra}]'`"
        ) from error
