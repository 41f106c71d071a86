"""Settings of the paper's own method: contact, extra closing, cutoff and force line."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from palpate.errors import InputError, RecordingError
from palpate.files import load_dataclass
from palpate.force.line_law import LineForceLaw


@dataclass(frozen=True, slots=True, kw_only=True)
class Paper:
    """Settings of a grasp with the paper's Figure 13 and equations 2 and 3.

    Attributes
    ----------
    step_mm : float
        Closing step before contact (section 4.1). Pressure-driven fingers use the step of their
        plan, kPa.
    epsilon_percent : float
        Contact threshold: mean relative change of all pixels (section 4.1).
    extra_mm : float
        Further closing after contact.
    cutoff_s : float
        Time from the last movement to the prediction (section 2.2).
    line : LineForceLaw or None
        Force as a function of the settled mean change (Table 4); None if the calibration has no
        settled pairs.

    Raises
    ------
    ValueError
        If a setting is out of its range.

    Examples
    --------
    >>> Paper.from_text(Paper(extra_mm=0.5).as_text()).extra_mm
    0.5
    """

    step_mm: float = 1.0
    epsilon_percent: float = -10.0
    extra_mm: float = 0.0
    cutoff_s: float = 2.5
    line: LineForceLaw | None = None

    def __post_init__(self) -> None:
        for name, wrong, rule in (
            ("step_mm", not 0 < self.step_mm < math.inf, "above 0"),
            ("epsilon_percent", not -100 < self.epsilon_percent < 0, "between -100 and 0"),
            ("extra_mm", not 0 <= self.extra_mm < math.inf, "0 or more"),
            ("cutoff_s", not 0.8 <= self.cutoff_s <= 60, "from 0.8 to 60"),
        ):
            if wrong:
                raise ValueError(f"{name} must be {rule}, not {getattr(self, name):g}")

    def as_text(self) -> str:
        """Return the settings as JSON, without the line, which the calibration determines."""
        return json.dumps({**asdict(self), "line": None})

    @classmethod
    def from_text(cls, text: str) -> Paper:
        """Read the output of `as_text`.

        Raises `RecordingError` if it can't be read.
        """
        try:
            return load_dataclass(cls, {k: v for k, v in json.loads(text).items() if k != "line"})
        except (ValueError, TypeError, AttributeError) as error:
            raise RecordingError(
                f"the recorded settings of the paper's method can't be read: {error}"
            ) from error


def read_settings(
    method: str, settings: Mapping[str, float | None], *, names: Mapping[str, str]
) -> Paper | None:
    """Return the settings of the paper's method; None for the default method.

    `settings`: fields of `Paper`; None means the field's default.
    `names`: names of the method and of the fields in messages.
    Raises `InputError` if the method is unknown, or a setting is out of range or given without the
    paper's method.

    >>> read_settings("paper", {"extra_mm": 0.5, "step_mm": None}, names={}).extra_mm
    0.5
    """
    given: dict[str, Any] = {n: value for n, value in settings.items() if value is not None}
    if method not in ("palpate", "paper"):
        raise InputError(f"method {method!r}: must be palpate or paper")
    if method != "paper":
        if given:
            options = ", ".join(names.get(name, name) for name in given)
            raise InputError(f"{options}: valid only with {names.get('method', 'method')} paper")
        return None
    try:
        return Paper(**given)
    except ValueError as error:
        name, rule = str(error).split(" ", 1)
        raise InputError(f"{names.get(name, name)} {rule}") from error
