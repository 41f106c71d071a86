"""A session of the page with a simulated rig."""

from __future__ import annotations

import pytest
from packages.station.tests.dashboard.test_live import SOURCE
from tests.unit.conftest import recorded

from palpate_station.dashboard.session import Session

__all__ = ["recorded", "session"]


@pytest.fixture
def session() -> Session:
    session = Session(send=lambda message: None)
    session.devices.live.open_source(SOURCE)
    return session
