"""A (simulated) apple felt before and after a fall, kept in a store, for `palpate bruise` to judge.

Usage: python bruised_apple.py [STORE]

On hardware the same records come of your own grasps: item, side, what each pixel felt.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.bruise.items import SOUND, examine_item
from palpate.produce.bruise.model import default_model
from palpate.produce.records import About, Grasp, Item, Source, Verdict
from palpate.produce.store import Store
from palpate_studies.bruise_grasps import ApplePress, press
from palpate_studies.fruit_ranges import DROPPED
from palpate_studies.twin_apple import Apple, draw_apple, draw_bruise
from palpate_studies.twin_session import Session

SENSOR, SIDES_DEG, CUTOFF_S = 31, (0.0, 90.0), 2.5
MONDAY = datetime(2026, 5, 4, 8, tzinfo=UTC)


def felt(item_id: str, felt_side: ApplePress, *, angle_deg: float, at: datetime) -> Grasp:
    """Put one grasp into the form that the store keeps."""
    width_mm = felt_side.width_mm
    pixels = felt_side.change_percent[felt_side.time_s <= CUTOFF_S][-3:].mean(axis=0)
    return Grasp(
        item_id=item_id,
        taken_at=at,
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=Outcome.HELD,
        measurements={
            "size_mm": Measurement(
                value=width_mm, low=width_mm - 0.5, high=width_mm + 0.5, unit="mm"
            )
        },
        pixel_settled_percent=tuple(map(tuple, pixels.tolist())),
        angle_deg=angle_deg,
    )


def feel_all_sides(
    store: Store, session: Session, apple: Apple, *, item_id: str, at: datetime
) -> None:
    """Grasp both pairs of sides of an apple, and keep that."""
    for turn, angle_deg in enumerate(SIDES_DEG):
        felt_side = press(session, apple, angle_deg=angle_deg)
        when = at + timedelta(seconds=20 * turn)
        store.add_grasp(felt(item_id, felt_side, angle_deg=angle_deg, at=when))
    session.world.place(None)


def main() -> None:
    """Fill the store, drop the apple, and ask."""
    session, rng = Session(SENSOR, level="lab"), np.random.default_rng(7)
    with Store.open(sys.argv[1] if len(sys.argv) > 1 else "sqlite://") as store:
        for number in range(3):
            name = f"sound-{number + 1}"
            store.add_item(Item(item_id=name, kind="apple"))
            sound = draw_apple(rng, bruises=None)
            feel_all_sides(store, session, sound, item_id=name, at=MONDAY)
            store.add_verdict(
                Verdict(
                    item_id=name,
                    about=About.BRUISE,
                    text=SOUND,
                    given_at=MONDAY,
                    source=Source.PERSON,
                )
            )
        apple = draw_apple(rng, bruises=None)
        store.add_item(Item(item_id="A17", kind="apple"))
        feel_all_sides(store, session, apple, item_id="A17", at=MONDAY)

        bruise = replace(draw_bruise(rng, DROPPED, apple), angle_deg=94.0)
        dropped = replace(apple, bruise=bruise)
        tuesday = MONDAY + timedelta(days=1)
        feel_all_sides(store, session, dropped, item_id="A17", at=tuesday)

        found = examine_item(store, "A17", model=default_model(), given_at=tuesday)
    print(f"A17 (simulated): {found.explanation}")
    print(f"truly bruised at 94°, {bruise.diameter_mm:.0f} mm across")


if __name__ == "__main__":
    main()
