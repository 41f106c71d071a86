"""What keeps a viewer's page up to date, and lets go of what is no longer on it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from nicegui import ui

from palpate.dashboard.session import Session
from palpate.dashboard.viewer import Viewer


def test_what_left_the_page_is_no_longer_refreshed() -> None:
    called: list[str] = []
    viewer = Viewer(Session(send=print), viewer_id="a")
    row = SimpleNamespace(is_deleted=False)
    viewer.on_refresh(lambda: called.append("page"))
    viewer.on_refresh(lambda: called.append("row"), of=cast(ui.element, row))
    viewer.refresh()
    assert called == ["page", "row"] * 2
    row.is_deleted = True
    called.clear()
    viewer.refresh()
    assert called == ["page"]
    # It was let go of: pages of a busy day would grow without end.
    row.is_deleted = False
    viewer.refresh()
    assert called == ["page"] * 2
