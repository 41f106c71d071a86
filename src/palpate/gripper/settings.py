"""Check of the numbers of a rig file's `[gripper]` table."""

from __future__ import annotations

from palpate.errors import InputError


def check_number(
    name: str, value: object, *, low: float, high: float, unit: str = "", whole: bool = False
) -> None:
    """Check that a setting is a number in its range.

    Parameters
    ----------
    name : str
        Key in the rig file.
    value : object
        The given value.
    low, high : float
        Range of the value, with both ends.
    unit : str
        Unit of the range in the message.
    whole : bool
        Whether only whole numbers are accepted.

    Raises
    ------
    InputError
        If the value is out of range, not a number, or not whole.

    Examples
    --------
    >>> check_number("jaw_mm", 0.0, low=10.0, high=300.0, unit="mm")
    Traceback (most recent call last):
    palpate.errors.InputError: jaw_mm 0: must be 10 to 300 mm
    >>> check_number("servo_id", 254, low=0, high=252, whole=True)
    Traceback (most recent call last):
    palpate.errors.InputError: servo_id 254: must be 0 to 252
    """
    allowed = f"{low:.10g} to {high:.10g} {unit}".rstrip()
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} {value!r}: must be a number, {allowed}")
    if not low <= value <= high:
        raise InputError(f"{name} {value:.10g}: must be {allowed}")
    if whole and value != int(value):
        raise InputError(f"{name} {value:.10g}: must be a whole number from {allowed}")
