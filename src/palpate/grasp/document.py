"""A grasp as the JSON that commands print and the bridges send (`docs/schemas/grasp.json`)."""

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
    truth: Mapping[str, object] | None,
    subject: str | None,
) -> dict[str, object]:
    """Return the document of a grasp that has ended.

    `damage_limit`: as `limit_document` gives it; None where there was no limit.
    `names`: what it is called elsewhere: ``item_id``, ``grasp_id``, ``recording``, ``ended_at``.
    `subject`: what the simulated world put between the fingers.
    """
    document: dict[str, object] = {
        **result.to_dict(),
        "verdict": verdict(result, target_force_n=target_force_n),
        "damage_limit": damage_limit,
        **names,
    }
    if truth is not None:
        document |= {"simulated": True, "object": subject, "truth": dict(truth)}
    return document


def limit_document(
    file: DamageFile, *, path: Path, kind: str, low_n: float, result: GraspResult
) -> dict[str, object]:
    """Return a learned limit and its effect.

    `low_n` is the limit of this object, newtons; infinite where its closing did not show it.
    """
    shown = math.isfinite(low_n)
    return {
        "file": str(path),
        "kind": kind or None,
        "closings": file.closings[kind] if kind else sum(file.closings.values()),
        "rate": file.model.rate,
        "low_n": low_n if shown else None,
        "passed": shown and (result.peak_force_n or 0.0) > low_n,
        "kept_below_target": result.is_limited,
    }
