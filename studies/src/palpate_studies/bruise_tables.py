"""Tables of the study `bruise`: by method, by size, beyond the touch, and how reliable."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.produce.bruise.model import BruiseModel
from palpate_studies.bruise_data import EARLY_S, SIDES_AROUND, Examined
from palpate_studies.bruise_scores import (
    EARLIER,
    FALSE_ALARMS,
    KIND,
    Scored,
    around,
    felt_of,
    log_odds,
    probabilities,
    scored,
    way,
)
from palpate_studies.report import Table
from palpate_studies.twin_session import LEVELS

#: Edges of the bins of the reliability plot, and of bruises by diameter, mm.
_SAID = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
_DIAMETERS_MM = (4.0, 7.0, 11.3, 15.0, 20.0, 30.0)
#: What is shown of ours: against which references, and in words.
SHOWN = {KIND: "ours, first met, 2.5 s", EARLIER: "ours, with its earlier record, 2.5 s"}


def of_purpose(examined: Sequence[Examined], purpose: str, level: str) -> list[Examined]:
    """Return those of one purpose and level."""
    return [one for one in examined if (one.purpose, one.level) == (purpose, level)]


def reliability(one: Scored) -> list[dict[str, float]]:
    """Return, for bins of the stated probability, how many sides really were bruised.

    `low` and `high` are the 90 % Wilson interval of the share.
    """
    probability, found, z = probabilities(one), [], 1.645
    for low, high in itertools.pairwise(_SAID):
        inside = (probability >= low) & ((probability < high) | (high == 1.0))
        sides = int(inside.sum())
        if not sides:
            continue
        share = float(one.bruised[inside].mean())
        middle = (share + z**2 / (2 * sides)) / (1 + z**2 / sides)
        half = z * np.sqrt(share * (1 - share) / sides + z**2 / (4 * sides**2)) / (1 + z**2 / sides)
        found.append(
            {
                "said": float(probability[inside].mean()),
                "bruised": share,
                "low": min(float(middle - half), share),
                "high": max(float(middle + half), share),
                "sides": sides,
            }
        )
    return found


def areas_table(scores: Mapping[str, Mapping[str, Scored]]) -> Table:
    """Put the areas under the ROC curves into a table."""
    rows = []
    for name in scores[LEVELS[0]]:
        cells = []
        for level in LEVELS:
            one = scores[level][name]
            span = one.interval()
            between = "" if span is None else " ({:.3f} to {:.3f})".format(*span)
            cells += [f"{one.auc:.3f}{between}", f"{100 * one.found():.0f}"]
        rows.append([name, *cells])
    return Table(
        title="Bruised or not, from one grasp of the side: area under the ROC curve (90 % interval "
        f"over sensors), and percent found at {100 * FALSE_ALARMS:g} % false alarms",
        columns=(
            "way",
            *(column for level in LEVELS for column in (f"AUC, {level}", f"found, {level}")),
        ),
        rows=rows,
    )


def by_size(
    examined: Sequence[Examined], level: str, model: BruiseModel
) -> dict[str, list[dict[str, float]]]:
    """Score bruises by their diameter against the sound apples of the test."""
    sound = [one for one in of_purpose(examined, "test", level) if not one.bruised]
    bruised = [
        one
        for purpose in ("small", "test")
        for one in of_purpose(examined, purpose, level)
        if one.bruised
    ]
    diameter_mm = np.array([one.apple.bruise.diameter_mm for one in bruised if one.apple.bruise])
    found, felt = {}, felt_of(sound + bruised)
    for names, label in SHOWN.items():
        score = log_odds(felt, model, names)
        quiet, loud = score[: len(sound)], score[len(sound) :]
        rows = []
        for low, high in itertools.pairwise(_DIAMETERS_MM):
            inside = (diameter_mm >= low) & (diameter_mm < high)
            if inside.any():
                chosen = Scored(
                    bruised=np.repeat([False, True], [len(quiet), int(inside.sum())]),
                    score=np.concatenate([quiet, loud[inside]]),
                    sensors=(),
                )
                rows.append(
                    {
                        "from_mm": low,
                        "to_mm": high,
                        "bruises": int(inside.sum()),
                        "auc": chosen.auc,
                        "found": chosen.found(),
                    }
                )
        found[label] = rows
    return found


def sizes_table(sizes: Mapping[str, Mapping[str, Sequence[Mapping[str, float]]]]) -> Table:
    """Put what was found by size into a table."""
    rows = [
        [
            label,
            f"{row['from_mm']:g} to {row['to_mm']:g}",
            level,
            str(row["bruises"]),
            f"{row['auc']:.3f}",
            f"{100 * row['found']:.0f}",
        ]
        for label in SHOWN.values()
        for level in LEVELS
        for row in sizes[level][label]
    ]
    return Table(
        title="By diameter of the bruise (below 11.3 mm: smaller than what was learned from)",
        columns=("way", "diameter, mm", "level", "bruises", "AUC", "found, %"),
        rows=rows,
    )


def beyond_touch(
    examined: Sequence[Examined], level: str, model: BruiseModel
) -> dict[str, dict[str, float]]:
    """Score what the fingers hardly touch: bruises off the belt, and sides nobody pointed at."""
    sound = [one for one in of_purpose(examined, "test", level) if not one.bruised]
    off = sound + of_purpose(examined, "off", level)
    round_about = around(of_purpose(examined, "around", level), model)
    found = {
        "12 to 25 mm above the middle, with its earlier record": scored(
            off, log_odds(felt_of(off), model, EARLIER)
        ),
        f"anywhere on a belt of 20 mm, first met, {SIDES_AROUND} grasps around": round_about,
    }
    return {name: {"auc": one.auc, "found": one.found()} for name, one in found.items()}


def beyond_table(
    beyond: Mapping[str, Mapping[str, Mapping[str, float]]],
    places: Mapping[str, Mapping[str, float] | None],
) -> Table:
    """Put what fingers hardly touch, and where bruises were located, into a table."""
    rows = [
        [
            name,
            *("AUC {auc:.3f}, found {found:.0%}".format(**beyond[level][name]) for level in LEVELS),
        ]
        for name in beyond[LEVELS[0]]
    ]
    texts = {
        "finger named rightly": "{finger_right:.0%}",
        "place on that finger, median off (off if its middle is named)": (
            "{median_off_mm:.1f} mm ({median_spread_mm:.1f} mm)"
        ),
    }
    for name, text in texts.items():
        found = [places[level] for level in LEVELS]
        rows.append([name, *("too few" if one is None else text.format(**one) for one in found)])
    return Table(
        title="Bruises that the fingers may not touch, and where those that they touch are",
        columns=("what", *LEVELS),
        rows=rows,
    )


def reliability_table(scores: Mapping[str, Mapping[str, Scored]]) -> Table:
    """Return a table of how far the probabilities can be trusted."""
    rows = []
    for names, label in SHOWN.items():
        cells = []
        for level in LEVELS:
            one = scores[level][way(names, EARLY_S)]
            stated, truth = probabilities(one), one.bruised
            bins = reliability(one)
            apart = sum(b["sides"] * abs(b["said"] - b["bruised"]) for b in bins) / len(stated)
            cells += [f"{np.mean((stated - truth) ** 2):.3f}", f"{apart:.3f}"]
        rows.append([label, *cells])
    return Table(
        title="Probabilities on apples and sensors not learned from: Brier score (0.25: knows "
        "nothing), and mean distance of stated probability and share bruised",
        columns=(
            "way",
            *(column for level in LEVELS for column in (f"Brier, {level}", f"apart, {level}")),
        ),
        rows=rows,
    )
