"""Options of the paper's method, shared by `grasp` and `replay`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.paper import Paper

Method: TypeAlias = Literal["palpate", "paper"]

MethodOption: TypeAlias = Annotated[
    Method, typer.Option(help="paper: fixed steps to contact, an exponential, a line for force.")
]
StepOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--step-mm", help="Paper's method: closing step before contact. [default: 1]", metavar="MM"
    ),
]
EpsilonOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--epsilon",
        help="Paper's method: mean change of contact, %. [default: -10]",
        metavar="PERCENT",
    ),
]
ExtraOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--extra-mm", help="Paper's method: closing after contact. [default: 0]", metavar="MM"
    ),
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--cutoff",
        help="Paper's method: seconds to the prediction. [default: 2.5]",
        metavar="SECONDS",
    ),
]


def paper_settings(
    method: Method,
    *,
    step_mm: float | None = None,
    epsilon_percent: float | None = None,
    extra_mm: float | None = None,
    cutoff_s: float | None = None,
) -> Paper | None:
    """Return the settings that a user asks for, None for the default method.

    Raises `InputError` if one is out of its range, or given without the paper's method.
    """
    from palpate.grasp.paper import Paper

    options = {
        "--step-mm": step_mm,
        "--epsilon": epsilon_percent,
        "--extra-mm": extra_mm,
        "--cutoff": cutoff_s,
    }
    given = [name for name, value in options.items() if value is not None]
    if method != "paper":
        if given:
            raise InputError(f"{', '.join(given)}: only with --method paper")
        return None
    settings: dict[str, Any] = {
        "step_mm": step_mm,
        "epsilon_percent": epsilon_percent,
        "extra_mm": extra_mm,
        "cutoff_s": cutoff_s,
    }
    try:
        return Paper(**{name: value for name, value in settings.items() if value is not None})
    except ValueError as error:
        raise InputError(str(error)) from error
