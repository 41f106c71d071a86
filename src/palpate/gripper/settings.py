"""Check of the numbers of a rig file's `[gripper]` table."""

from __future__ import annotations

from palpate.errors import InputError


def check_number(
    name: str, value: float, *, low: float, high: float, unit: str = "", whole: bool = False
) -> None:
    """Check that a setting is a number in its range.

    Parameters
    ----------
    name : str
        Key in the rig file.
    value : float
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
    palpate.errors.InputError: servo_id 254: must be a whole number from 0 to 252
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and low <= value <= high and (not whole or value == int(value)):
        return
    shown = f"{value:g}" if is_number else repr(value)
    kind = "a whole number from " if whole else ""
    raise InputError(f"{name} {shown}: must be {kind}{low:g} to {high:g} {unit}".rstrip())
