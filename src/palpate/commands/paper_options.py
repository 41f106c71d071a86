"""Options of the paper's method, shared by `grasp` and `replay`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

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
    typer.Option("--step-mm", help="Paper's method: closing step before contact. [default: 1]"),
]
EpsilonOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--epsilon", help="Paper's method: mean change of contact, %. [default: -10]"),
]
ExtraOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--extra-mm", help="Paper's method: closing after contact. [default: 0]"),
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--cutoff", help="Paper's method: seconds to the prediction. [default: 2.5]"),
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
    usual = Paper()
    try:
        return Paper(
            step_mm=usual.step_mm if step_mm is None else step_mm,
            epsilon_percent=usual.epsilon_percent if epsilon_percent is None else epsilon_percent,
            extra_mm=usual.extra_mm if extra_mm is None else extra_mm,
            cutoff_s=usual.cutoff_s if cutoff_s is None else cutoff_s,
        )
    except ValueError as error:
        raise InputError(str(error)) from error
