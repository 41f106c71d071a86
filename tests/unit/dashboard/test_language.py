"""Every text of the pages is in every catalogue, and none that no page shows."""

from __future__ import annotations

import ast
import pickle
import re
from collections.abc import Iterator
from datetime import datetime
from itertools import product
from pathlib import Path
from string import Formatter

import pytest

import palpate.dashboard
from palpate.dashboard.activity import Activity
from palpate.dashboard.language import LANGUAGES, Message, language_for
from palpate.dashboard.po_file import po_entries
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.grasp.verdict import UNKNOWN_FIRMNESS, firmness, outcome_text

FOLDER = Path(palpate.dashboard.__file__).parent
TRANSLATED = [code for code in LANGUAGES if code != "en"]


def shown_texts() -> set[str]:
    """Return every text that a page can show, as the code has it."""
    found = {str(activity) for activity in Activity}
    for outcome in Outcome:
        found |= {outcome_text(outcome), str(outcome).replace("_", " ")}
    found |= set(firmness_words())
    for file in FOLDER.glob("*.py"):
        found |= set(python_texts(file))
    for file in (FOLDER / "static").glob("*.html"):
        found |= set(re.findall(r"\{\{(.+?)\}\}", file.read_text()))
    for file in (FOLDER / "static").glob("*.js"):
        found |= set(re.findall(r'\bt\("((?:[^"\\]|\\.)*)"', file.read_text()))
    return found


def python_texts(file: Path) -> Iterator[str]:
    """Yield the texts given to `tr`, `tr.many` or a `Message`."""
    for call in ast.walk(ast.parse(file.read_text())):
        if not isinstance(call, ast.Call):
            continue
        called = re.sub(r"^(viewer|self)\._?", "", ast.unparse(call.func))
        texts = {"tr": 1, "Message": 1, "tr.many": 2}.get(called, 0)
        for text in call.args[:texts]:
            if isinstance(text, ast.Constant) and isinstance(text.value, str) and text.value:
                yield text.value
            elif called == "tr.many":
                pytest.fail(f"{file.name}:{call.lineno}: no catalogue can hold {ast.unparse(text)}")


def firmness_words() -> Iterator[str]:
    """Yield every wording of a firmness, from every pair of bounds."""
    stiffnesses = (0.5, 2.0, 5.0, 12.0, 50.0)
    yield UNKNOWN_FIRMNESS
    for low, high in product(stiffnesses, repeat=2):
        if low <= high:
            yield firmness(Measurement(value=low, low=low, high=high, unit="n_per_mm"))
    for end in stiffnesses:
        for low, high in ((end, 1e6), (1e-6, end)):
            wide = Measurement(value=end, low=low, high=high, unit="n_per_mm")
            yield firmness(wide.or_bound("wide", least=0.02, most=500.0))


def entries(code: str) -> list[dict[str, str]]:
    return po_entries((FOLDER / "languages" / f"{code}.po").read_text(encoding="utf-8"))[1:]


@pytest.mark.parametrize("code", TRANSLATED)
def test_a_catalogue_has_every_text_once_and_no_other(code: str) -> None:
    known = [text for one in entries(code) for text in (one["msgid"], one.get("msgid_plural"))]
    texts = [text for text in known if text is not None]
    missing = "\n".join(
        f'msgid "{text}"\nmsgstr ""\n' for text in sorted(shown_texts() - set(texts))
    )
    assert missing == ""
    assert set(texts) - shown_texts() == set()
    assert len(texts) == len(set(texts))


@pytest.mark.parametrize("code", TRANSLATED)
def test_a_translation_has_the_values_of_its_text(code: str) -> None:
    for one in entries(code):
        texts = {one["msgid"], one.get("msgid_plural", one["msgid"])}
        for translated in (text for name, text in one.items() if name.startswith("msgstr")):
            assert translated.strip(), one["msgid"]
            assert any(fields(translated) == fields(text) for text in texts), one["msgid"]


def fields(text: str) -> list[tuple[str | None, str | None]]:
    return sorted((name, spec) for _, name, spec, _ in Formatter().parse(text) if name is not None)


def test_a_message_is_english_until_it_is_translated_and_passes_between_processes() -> None:
    inner = Message("grasping")
    text = Message("{activity}: wait, or press stop", activity=inner)
    assert text == "grasping: wait, or press stop"
    german = language_for("de", "")
    assert german(pickle.loads(pickle.dumps(text))) == "greift: warten oder STOP drücken"
    braces = Message("Replay of {name}", name="{odd}")
    assert german(pickle.loads(pickle.dumps(braces))) == "Wiedergabe von {odd}"


def test_numbers_and_days_are_written_as_the_language_does() -> None:
    german = language_for("de", "")
    assert german.number(-1.25, "+.1f") == "\N{MINUS SIGN}1,2"
    assert german("{n:g} N", n=3.5) == "3,5 N"
    assert german.day(datetime(2026, 3, 5, 14, 7)) == "05.03. 14:07"


@pytest.mark.parametrize(
    ("asked", "accepted", "code"),
    [
        (None, "de-DE,de;q=0.9,en;q=0.8", "de"),
        (None, "en;q=0.2, de;q=0.7", "de"),
        (None, "de;q=0, en", "en"),
        ("de", "en-US", "de"),
        ("xx", "de", "de"),
        (None, ";q=, de;q=abc", "en"),
    ],
)
def test_the_address_comes_before_what_the_browser_prefers(
    asked: str | None, accepted: str, code: str
) -> None:
    assert language_for(asked, accepted).code == code


@pytest.mark.parametrize("text", ["msgid Stop\n", '"before any field"\n', "what\n"])
def test_a_catalogue_that_is_none_is_refused_by_its_line(text: str) -> None:
    with pytest.raises(ValueError, match="line 1"):
        po_entries(text)
