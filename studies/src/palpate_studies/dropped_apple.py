"""The apple of the paper's Table 6 and Figure 17, grasped before and after it was dropped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.settling.predict import predict_settled
from palpate.signal.relative import mean_change
from palpate.twin.objects import TwinObject
from palpate_studies.twin_apple import Apple, Bruise, Faces, draw_apple, first_touch
from palpate_studies.twin_session import HOLD_S, SETTLED_MEAN_S, Session, stack

#: Paper, Table 6: mean and standard deviation over 10 grasps, percent.
COLUMNS = ("before", "after", "only bruised")
PUBLISHED: dict[str, tuple[tuple[float, float], ...]] = {
    "exponential, 2.5 s": ((-24.9, 0.78), (-15.8, 1.3), (-5.89, 3.7)),
    "recorded, 20 s": ((-21.2, 1.9), (-13.0, 2.4), (-3.75, 1.6)),
}
SENSORS, REPEATS, FIRST_SENSOR = 3, 10, 70_000
#: The apple: round and of middling firmness. The width, which the paper doesn't print, gives the
#: published change before; the depth of the fresh dent the one after (-21.4 and -13.0 %: median of
#: 16 other sensors, seeds 71000 to 71015, at level lab).
SIZE_MM, FIRMNESS_N, CLOSURE_MM = 66.0, 16.0, 1.2
DROPPED = Bruise(
    angle_deg=0.0, height_mm=0.0, diameter_mm=28.0, depth_mm=9.8, softness=0.35, dent_mm=0.22
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """Traces of one sensor: column -> times and mean relative changes, shape (repeats, times).

    `support_n`: force that the support takes up at 20 s, because the fingers press unequally.
    """

    time_s: FloatArray
    traces: Mapping[str, FloatArray]
    support_n: float = 0.0

    def values(self, column: str, method: str, cutoff_s: float) -> FloatArray:
        """Return the settled value of each grasp of a column, percent, predicted at a cut-off."""
        traces = self.traces[column]
        if cutoff_s == HOLD_S:
            return np.asarray(traces[:, self.time_s > HOLD_S - SETTLED_MEAN_S].mean(axis=1))
        settled = predict_settled(
            self.time_s, traces, cutoff_s=cutoff_s, method=method, unit="percent"
        )
        return np.asarray(settled.value)


def dropped_apple() -> Apple:
    """Return the apple after its fall."""
    drawn = draw_apple(np.random.default_rng(6), bruises=None)
    flesh = replace(drawn.flesh, size_mm=SIZE_MM, force_at_1mm_n=FIRMNESS_N)
    return replace(
        drawn, flesh=flesh, oval=0.0, lobes=0.0, firmer=0.0, leaning_mm=0.0, bruise=DROPPED
    )


def grasp_free(level: str, sensor: int, *, repeats: int = REPEATS) -> Traces:
    """Grasp the apple before and after its fall, at one width, bruise to the first finger."""
    session, apple = Session(sensor, level=level), dropped_apple()
    before = _holds(session, replace(apple, bruise=None).facing(0.0), repeats=repeats)
    after = _holds(session, apple.facing(0.0), repeats=repeats)
    return _traces(session, before, after)


def grasp_supported(level: str, sensor: int, *, repeats: int = REPEATS) -> Traces:
    """Grasp the apple as `grasp_free` does, but held in place by what it rests on.

    Each finger then presses its own side by the same way, so forces are not equal. A side is that
    of an apple whose other side is alike: the bruised one twice for the first finger, the sound
    one twice for the second.
    """
    session, apple = Session(sensor, level=level), dropped_apple()
    sound = replace(apple, bruise=None).facing(0.0)
    before = _holds(session, sound, repeats=repeats)
    sound_n = session.world.truth().force_n
    bruised = _holds(session, _bruised_twice(apple), repeats=repeats)
    support_n = sound_n - session.world.truth().force_n
    other = _holds(session, sound, repeats=repeats)
    times = min(bruised.shape[1], other.shape[1])
    first = session.world.layout.finger_mask(0)
    after = np.where(first, bruised[:, :times], other[:, :times])
    return _traces(session, before, after, support_n=support_n)


def _traces(
    session: Session, before: FloatArray, after: FloatArray, *, support_n: float = 0.0
) -> Traces:
    times = min(before.shape[1], after.shape[1])
    first = session.world.layout.finger_mask(0)
    return Traces(
        time_s=np.arange(1, times + 1) / session.world.frame_rate_hz,
        traces={
            "before": mean_change(before)[:, :times],
            "after": mean_change(after)[:, :times],
            "only bruised": after[:, :times, first].mean(axis=2),
        },
        support_n=support_n,
    )


def _bruised_twice(apple: Apple) -> TwinObject:
    """Return an apple both of whose sides are its bruised one."""
    faces = apple.facing(0.0).faces
    assert isinstance(faces, Faces)
    bruised = faces.faces[0]
    alike = Faces(faces=(bruised, bruised), fruit_mm=faces.fruit_mm)
    return replace(
        apple.flesh,
        size_mm=SIZE_MM - 2.0 * first_touch(bruised)[0],
        force_at_1mm_n=apple.flesh.force_at_1mm_n * alike.stiffness,
        faces=alike,
    )


def _holds(session: Session, apple: TwinObject, *, repeats: int) -> FloatArray:
    """Return relative changes of every pixel, shape (repeats, times, rows, cols)."""
    holds = []
    for _ in range(repeats):
        session.place(apple)
        holds.append(session.hold(SIZE_MM, width_mm=SIZE_MM - CLOSURE_MM))
    return stack(holds)
