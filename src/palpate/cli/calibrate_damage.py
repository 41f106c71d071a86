"""`palpate calibrate damage`: damage limit of produce, from closings until rupture."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from palpate.calibrate.rest import format_now
from palpate.cli.options import JsonOption, opt
from palpate.cli.output import print_json
from palpate.errors import InputError
from palpate.files import check_not_input
from palpate.measurement import Measurement
from palpate.object.damage import NOMINAL_RATE
from palpate.object.damage_file import DamageFile
from palpate.object.damage_learning import (
    FruitClosing,
    find_unfit,
    learn_damage,
    read_closings,
    score_held_out,
)

#: Minimum number of closings for training and cross-validation.
_MIN_CLOSINGS = 12


def calibrate_damage(
    curves: Annotated[
        Path, opt("--curves CSV", "Closings: columns grasp_id, closure_mm, force_n.")
    ],
    index: Annotated[
        Path, opt("--index CSV", "Rupture forces: columns grasp_id, fruit, rupture_force_n.")
    ],
    out: Annotated[Path, opt("--out", "File to write.")] = Path("damage.json"),
    rate_percent: Annotated[
        float,
        opt(
            "--rate-percent PERCENT",
            "Accepted fraction of damaged produce at the limit.",
            min=0.01,
            max=50.0,
        ),
    ] = 100 * NOMINAL_RATE,
    as_json: JsonOption = False,
) -> None:
    """Learn the damage limit of grasps from produce squeezed until rupture.

    The model is cross-validated on held-out closings. Use the file with `palpate grasp --damage
    FILE --kind KIND`.

    Example: palpate calibrate damage --curves closings.csv --index ruptures.csv --out damage.json
    """
    check_not_input(out, inputs=(curves, index))
    damage_file = _learn(
        read_closings(curves, index), files=(curves, index), rate=rate_percent / 100
    )
    damage_file.save(out)
    if as_json:
        print_json(_document(damage_file, path=out))
    else:
        _print(damage_file, path=out)


def _learn(closings: list[FruitClosing], *, files: tuple[Path, ...], rate: float) -> DamageFile:
    left_out = find_unfit(closings)
    used = [closing for closing in closings if closing.grasp_id not in left_out]
    if len(used) < _MIN_CLOSINGS:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(
            f"{files[1]}: {len(used)} usable closings, but at least {_MIN_CLOSINGS} are needed"
            f"{f' (excluded: {why})' if why else ''}; add more closings"
        )
    kinds = sorted({closing.fruit for closing in used})
    return DamageFile(
        model=learn_damage(used, rate=rate),
        closings={kind: sum(closing.fruit == kind for closing in used) for kind in kinds},
        learned_from={path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
        made_at=format_now(),
        left_out=left_out,
        held_out=score_held_out(used),
    )


def _limit_n(damage_file: DamageFile, kind: str) -> float:
    """Return the force limit of a grasp at the kind's median stiffness."""
    middle = math.exp(damage_file.model.strengths[kind].log_stiffness)
    stiffness = Measurement(value=middle, low=0.9 * middle, high=1.1 * middle, unit="n_per_mm")
    return damage_file.model.bound_n(stiffness, kind=kind)


def _document(damage_file: DamageFile, *, path: Path) -> dict[str, Any]:
    return {
        "file": str(path),
        "closings": dict(damage_file.closings),
        "left_out": dict(damage_file.left_out),
        "kinds": list(damage_file.kinds),
        "held_out": {kind: asdict(one) for kind, one in damage_file.held_out.items()},
        "rate": damage_file.model.rate,
        "limit_at_middle_stiffness_n": {
            kind: _limit_n(damage_file, kind) for kind in damage_file.model.strengths
        },
        "verdict": _verdict(damage_file),
    }


def _print(damage_file: DamageFile, *, path: Path) -> None:
    counts = ", ".join(f"{count} {kind}" for kind, count in damage_file.closings.items())
    print(f"{path}: learned from {sum(damage_file.closings.values())} closings ({counts})")
    for name, why in damage_file.left_out.items():
        print(f"excluded: {name}, {why}")
    print("held-out closings: error of the predicted rupture force, error of the kind's median")
    print("rupture force, and fraction that withstood the lower bound (target 95 %):")
    width = max(len("unknown"), *map(len, damage_file.held_out))
    for kind, one in damage_file.held_out.items():
        print(
            f"  {kind or 'unknown':<{width}}  {one.error_percent:3.0f} %  "
            f"{one.median_error_percent:3.0f} %  {100 * one.above_low:3.0f} % of {one.closings}"
        )
    percent = 100 * damage_file.model.rate
    print(f"force limit at median stiffness (at most {percent:g} % of produce damaged):")
    for kind in damage_file.model.strengths:
        print(f"  {kind or 'unknown':<{width}}  {_limit_n(damage_file, kind):5.2f} N")
    for line in _verdict(damage_file):
        print(line)


def _verdict(damage_file: DamageFile) -> list[str]:
    """Return the caveats of the limit."""
    remarks = []
    for kind, one in damage_file.held_out.items():
        who = kind or "produce of any kind"
        if one.error_percent >= one.median_error_percent:
            remarks.append(
                f"{who}: stiffness does not predict the strength, so the limit is constant"
            )
        # Three standard deviations below the intended 95 %.
        if one.above_low < 0.95 - 3 * math.sqrt(0.95 * 0.05 / one.closings):
            remarks.append(
                f"{who}: too few closings withstood the lower bound; check the rupture forces"
            )
    for kind, count in damage_file.closings.items():
        if kind not in damage_file.kinds:
            remarks.append(f"{kind}: too few closings for a separate limit ({count})")
        elif kind not in damage_file.held_out:
            remarks.append(f"{kind}: too few closings for held-out validation ({count})")
    return remarks or [
        f"usable: stiffness predicts the strength of {', '.join(damage_file.kinds) or 'these'}"
    ]
