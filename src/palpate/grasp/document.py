"""JSON document of a grasp, for commands and bridges (`docs/schemas/grasp.json`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from palpate.estimate.damage_file import DamageFile
from palpate.grasp.result import GraspResult
from palpate.grasp.verdict import verdict


def grasp_document(
    result: GraspResult,
    *,
    target_force_n: float | None,
    damage_limit: Mapping[str, object] | None,
    names: Mapping[str, str],
    simulated: bool,
    truth: Mapping[str, object] | None,
    subject: str | None,
) -> dict[str, object]:
    """Return the JSON document of a finished grasp.

    `damage_limit`: output of `damage_limit_document`; None without a limit.
    `names`: values of ``item_id``, ``grasp_id``, ``recording`` and ``ended_at``.
    `simulated`: whether the rig is simulated.
    `truth`: true values of a simulated grasp; None if unknown.
    `subject`: name of the simulated object.
    """
    document: dict[str, object] = {
        **result.to_dict(),
        "verdict": verdict(result, target_force_n=target_force_n),
        "damage_limit": damage_limit,
        **names,
    }
    if simulated:
        document |= {"simulated": True, "object": subject}
    if truth is not None:
        document["truth"] = dict(truth)
    return document


def damage_limit_document(
    file: DamageFile, *, path: Path, kind: str, low_n: float, result: GraspResult
) -> dict[str, object]:
    """Return the JSON form of a learned damage limit and its effect on a grasp.

    `low_n`: limit of this object, newtons; infinite if the closing did not determine it.
    """
    is_known = math.isfinite(low_n)
    return {
        "file": str(path),
        "kind": kind or None,
        "closings": file.closings[kind] if kind else sum(file.closings.values()),
        "rate": file.model.rate,
        "low_n": low_n if is_known else None,
        "passed": is_known and (result.peak_force_n or 0.0) > low_n,
        "kept_below_target": result.is_limited,
    }
