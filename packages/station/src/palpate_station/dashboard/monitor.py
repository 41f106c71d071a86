"""Health of a station, and its metrics in the text format of Prometheus."""

from __future__ import annotations

import math
import shutil
import time
from collections import Counter
from typing import TYPE_CHECKING, Any, TypeAlias

from palpate.grasp.document import GraspDocument
from palpate.grasp.result import Outcome
from palpate.version import __version__
from palpate_station.dashboard.app_state import AppState
from palpate_station.dashboard.messages import DeviceActivity
from palpate_station.store.outbox import SHARED

if TYPE_CHECKING:
    from palpate_station.mqtt.publisher import Publisher

#: Name, type, description, and samples by label of a metric.
_Family: TypeAlias = "tuple[str, str, str, float | dict[str, float]]"

#: A station with less free space in its folder is not healthy, bytes (guess: a day of grasps).
_MIN_FREE_BYTES = 1_000_000_000


class Monitor:
    """Counts the grasps of a station and examines its state."""

    def __init__(self, app_state: AppState, publisher: Publisher | None = None) -> None:
        self._app_state, self._publisher = app_state, publisher
        self._began_s = time.monotonic()
        self._outcomes: Counter[Outcome] = Counter()
        self._stored, self._seconds = Counter[bool](), 0.0
        app_state.on_result.append(self._count)

    def _count(self, document: GraspDocument) -> None:
        self._outcomes[document.result.outcome] += 1
        self._stored[bool(document.stored)] += 1
        self._seconds += document.result.decision_time_s or 0.0

    def problems(self) -> list[str]:
        """Return what keeps the station from grasping and storing; empty if it is healthy."""
        found, app_state = self.device_problems(), self._app_state
        if app_state.item_store.trouble:
            found.append(app_state.item_store.trouble)
        if self._free_bytes() < _MIN_FREE_BYTES:
            found.append(f"{app_state.settings.folder}: less than 1 GB of disk space is free")
        return found

    def delivery_problems(self) -> list[str]:
        """Return what keeps results from the plant; the station grasps and stores all the same."""
        found, item_store = [], self._app_state.item_store
        if (fault := item_store.shared_fault) is not None:
            text = str(fault).replace("the store", "the shared store", 1)
            found.append(f"{text}; {_waiting_text(item_store.waiting())}")
        if self._publisher is not None and (why := self._publisher.fault):
            waiting = item_store.waiting(self._publisher.receiver)
            found.append(f"the broker {why}; {_waiting_text(waiting)}")
        return found

    def device_problems(self) -> list[str]:
        """Return what keeps the station from grasping; empty if nothing does."""
        app_state = self._app_state
        state, activity = app_state.state(), app_state.session.devices.activity
        found = []
        if activity is DeviceActivity.GONE:
            found.append("the device process has ended: restart palpate serve")
        elif app_state.session.silence_s is not None:
            found.append("the devices do not respond")
        elif activity in (DeviceActivity.IDLE, DeviceActivity.OPENING):
            is_opening = activity is DeviceActivity.OPENING
            found.append("the rig is being opened" if is_opening else "no rig is open")
        elif activity is DeviceActivity.WATCHING and not state["fresh"]:
            found.append("no fresh frames")
        return found

    def health(self) -> dict[str, Any]:
        """Return the health document."""
        problems, state = self.problems(), self._app_state.state()
        return {
            "healthy": not problems,
            "problems": problems + self.delivery_problems(),
            "version": __version__,
            "uptime_s": round(time.monotonic() - self._began_s, 1),
            **{name: state[name] for name in ("state", "activity", "fresh", "simulated", "rig")},
        }

    def metrics(self) -> str:
        """Return the metrics, one sample per line."""
        state = self._app_state.state()
        outcomes = {f'{{outcome="{one}"}}': float(self._outcomes[one]) for one in Outcome}
        stored = {
            f'{{stored="{str(one).lower()}"}}': float(self._stored[one]) for one in (True, False)
        }
        healthy, uptime_s = not self.problems(), time.monotonic() - self._began_s
        families: list[_Family] = [
            ("healthy", "gauge", "Whether the station can grasp and store.", healthy),
            ("state", "gauge", "State, numbered as in the line protocols.", state["state_number"]),
            ("frames_fresh", "gauge", "Whether frames are arriving.", state["fresh"]),
            ("grasps_total", "counter", "Finished grasps by outcome.", outcomes),
            ("grasps_stored_total", "counter", "Finished grasps by storage.", stored),
            ("decision_seconds_total", "counter", "Contact to answer, all grasps.", self._seconds),
            ("stops_total", "counter", "Stops by all clients.", state["stops"]),
            ("disk_free_bytes", "gauge", "Free space of the folder.", self._free_bytes()),
            ("uptime_seconds", "gauge", "Time since the start.", uptime_s),
            *self._delivery_metrics(),
        ]
        lines = []
        for name, kind, about, samples in families:
            lines += [f"# HELP palpate_{name} {about}", f"# TYPE palpate_{name} {kind}"]
            labelled = samples if isinstance(samples, dict) else {"": samples}
            lines += [f"palpate_{name}{label} {float(one)!r}" for label, one in labelled.items()]
        return "\n".join(lines) + "\n"

    def _delivery_metrics(self) -> list[_Family]:
        """Return the metrics of the broker and of the shared store, if the station has them."""
        found: list[_Family] = []
        receivers, item_store = dict[str, str](), self._app_state.item_store
        if (silence_s := item_store.shared_silence_s) is not None:
            receivers["database"] = SHARED
            answers = item_store.shared_fault is None
            about = "Whether the shared store answered when it was last used."
            found.append(("database_reachable", "gauge", about, answers))
            about = "Time since the last answer of the shared store, at first since the start."
            found.append(("database_last_answer_seconds", "gauge", about, silence_s))
        if self._publisher is not None:
            receivers["broker"] = self._publisher.receiver
            connected = self._publisher.is_connected
            found.append(("broker_connected", "gauge", "Whether the broker answers.", connected))
        if receivers:
            waiting = {
                f'{{receiver="{name}"}}': math.nan if count is None else float(count)
                for name, count in (
                    (name, item_store.waiting(one)) for name, one in receivers.items()
                )
            }
            about = "Records on the disk that have not reached their receiver."
            found.append(("waiting_records", "gauge", about, waiting))
        return found

    def _free_bytes(self) -> int:
        return shutil.disk_usage(self._app_state.settings.existing_folder).free


def _waiting_text(count: int | None) -> str:
    return "records wait" if count is None else f"records waiting in the local store: {count}"
