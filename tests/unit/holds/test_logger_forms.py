"""Every form in which a logger writes is read right, or refused with the choice named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.logger_forms import FORMS, ROWS, TIME_S, Form

from palpate.errors import InputError
from palpate.holds.recordings import read_recordings


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.what)
def test_form_is_read_or_refused(form: Form, tmp_path: Path) -> None:
    path = tmp_path / f"log{form.ending}"
    content = form.content
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if form.refused:
        with pytest.raises(InputError) as refusal:
            read_recordings(path, **form.options)
        assert form.refused in str(refusal.value)
        assert str(refusal.value).count("\n") == 0
        return
    found = read_recordings(path, **form.options)
    parts = {one.name.partition(":")[2]: one for one in found}
    wanted = form.columns if len(found) > 1 else {"": form.columns}
    assert {name: [*one.columns] for name, one in parts.items()} == {
        name: [*columns] for name, columns in wanted.items()
    }
    for name, columns in wanted.items():
        for column, values in columns.items():
            np.testing.assert_allclose(parts[name].columns[column], values, rtol=1e-9)
            if len(values) == len(ROWS):
                since_s = parts[name].time_s - parts[name].time_s[0]
                np.testing.assert_allclose(since_s, TIME_S, atol=1e-4)
