"""Training tables with people's labels: kind, bruise, ripeness or grade."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.holds.strict import read_table
from palpate_station.bruise.examination import read_labelled_sides
from palpate_station.learning import LabelledTable
from palpate_station.records import About, Grasp, Source
from palpate_station.ripeness.history import read_labelled_histories

if TYPE_CHECKING:
    from palpate_station.store import Store

#: Features of a grade or a kind: means over an item's grasps, as logarithms if the name ends in
#: "mm".
_GRADE_FEATURES = ("size_mm", "stiffness_n_per_mm", "firmness", "settled_percent")


def read_labelled(path: str | os.PathLike[str]) -> LabelledTable:
    """Read a CSV with columns ``item_id``, ``label`` (may be empty) and numbers.

    Raises `InputError` if the file can't be read, has no numeric column, or a field is not a
    number.

    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "grades.csv"
    >>> _ = path.write_text("item_id,label,firmness,size_mm\\nA1,soft,41,60\\nA2,,47,61\\n")
    >>> table = read_labelled(path)
    >>> table.features, table.rows.tolist(), table.find_unlabelled()
    (('firmness', 'size_mm'), [[41.0, 60.0], [47.0, 61.0]], [1])
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            names = next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't be read ({error})") from error
    features = tuple(name for name in names if name not in ("item_id", "label"))
    if not features:
        raise InputError(f"{path}: has no numeric column besides item_id and label")
    columns = read_table(
        path,
        columns={"item_id": "text", "label": "text", **dict.fromkeys(features, "number")},
    )
    return LabelledTable(
        features=features,
        rows=np.column_stack([columns[name] for name in features]),
        labels=tuple(str(label).strip() for label in columns["label"]),
        items=tuple(map(str, columns["item_id"])),
    )


def read_labels_about(store: Store, about: About, *, kind: str | None) -> LabelledTable:
    """Return the training table of the store's grasps and people's labels.

    `about`: subject of the labels; it determines the rows. Identity and bin (a grade): one row per
        measured item, labelled or not. Ripeness: one row per labelled day of an item grasped with
        width-driven fingers. Bruise: one row per grasp of a labelled side, for the reference with
        the most rows.
    `kind`: only items of this kind; required for bruise and ripeness.
    Raises `InputError` if a required kind is missing, or the table is empty.
    """
    if about in (About.BRUISE, About.RIPENESS) and kind is None:
        raise InputError(f"{about}: name the kind of the items with --kind")
    if about is About.BRUISE:
        sides = read_labelled_sides(store, kind=str(kind)).values()
        table = max(sides, key=lambda one: len(one.rows), default=None)
    elif about is About.RIPENESS:
        table = _ripeness_table(store, kind=str(kind))
    else:
        table = _item_table(store, about, kind=kind)
    if table is None or not (table.labels or table.left_out):
        raise InputError(
            f"{store.name}: no grasp to learn {about} from; label items: palpate items NAME "
            f"--say {about}=LABEL"
        )
    return table


def _item_table(store: Store, about: About, *, kind: str | None) -> LabelledTable:
    labels = {one.item_id: one.text for one in store.verdicts(about, source=Source.PERSON)}
    rows, left_out = [], {}
    for item in store.items(kind=kind):
        fallback = item.kind or "" if about is About.IDENTITY else ""
        label = labels.get(item.item_id, fallback)
        means = _means(store.grasps_of(item.item_id))
        missing = [
            name for name, mean in zip(_GRADE_FEATURES, means, strict=True) if np.isnan(mean)
        ]
        if not missing:
            rows.append((means, label, item.item_id))
        elif label:
            left_out[item.item_id] = missing[0]
    return LabelledTable.from_rows(_GRADE_FEATURES, rows, left_out=left_out)


def _means(grasps: Sequence[Grasp]) -> list[float]:
    """Return the mean measurements of held grasps; NaN for a missing one.

    Of a bound the middle of its interval counts, as in `identify`.
    """
    found = []
    for name in _GRADE_FEATURES:
        values = [
            one.measurements[name].middle
            for one in grasps
            if one.outcome is Outcome.HELD
            and name in one.measurements
            # The limits of a bound may be infinite.
            and np.isfinite(one.measurements[name].middle)
        ]
        if not values:
            found.append(math.nan)
            continue
        mean = float(np.mean(values))
        found.append(float(np.log(mean)) if name.endswith("mm") and mean > 0 else mean)
    return found


def _ripeness_table(store: Store, *, kind: str) -> LabelledTable:
    verdicts = store.verdicts(About.RIPENESS, source=Source.PERSON, kind=kind)
    rows = [
        ([day.firmness], label, history.item_id)
        for history, labels in read_labelled_histories(store, verdicts, drive="width")
        for day, label in zip(history.days, labels, strict=True)
        if label is not None
    ]
    return LabelledTable.from_rows(("ln_stiffness",), rows)
