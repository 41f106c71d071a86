"""Rules files: reading, and a one-line error for each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate_station.sorting.conditions import OneOf, Within
from palpate_station.sorting.rules import RuleBook
from palpate_station.sorting.rules_file import check_kinds, read_rules

GOOD = """\
default = "by hand"

[[rule]]
bin = "small"
class = ["kiwi", "lime"]
size_mm = [0, 45]

[[rule]]
bin = "ripe"
class = "avocado"
ripeness = "ripe"
bruised = false
confidence = 0.9
"""


def read(folder: Path, text: str) -> RuleBook:
    path = folder / "rules.toml"
    path.write_text(text)
    return read_rules(path)


def read_two(folder: Path, first: str, second: str) -> RuleBook:
    """Read two rules with these conditions; the second begins on line 5 or later."""
    rules = (f'[[rule]]\nbin = "{name}"\n{one}\n' for name, one in (("a", first), ("b", second)))
    return read(folder, 'default = "x"\n' + "".join(rules))


def test_read_rules_preserves_order_and_conditions(tmp_path: Path) -> None:
    book = read(tmp_path, GOOD)
    assert (book.bins, book.most_grasps) == (("small", "ripe", "by hand"), 3)
    small, ripe = book.rules
    fruit = OneOf("class", frozenset({"kiwi", "lime"}))
    assert small.conditions == (fruit, Within("size_mm", 0, 45))
    assert (small.confidence, small.line, ripe.confidence) == (0.8, 3, 0.9)
    wanted = (("class", "avocado"), ("ripeness", "ripe"), ("bruised", "false"))
    assert ripe.conditions == tuple(OneOf(key, frozenset({name})) for key, name in wanted)


def test_read_rules_accepts_the_example_file() -> None:
    examples = Path(__file__).resolve().parents[4] / "examples"
    assert "eggs" in read_rules(examples / "sorting-rules.toml").bins


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('class = "avocado"', 'clas = "avocado"', "line 10: unknown key 'clas'; .* bin, cl"),
        ('default = "by hand"', "", "line 1: has no default"),
        ('bin = "ripe"', "", "line 8: this rule has no bin"),
        ("[0, 45]", "[45, 0]", r"line 6: size_mm is \[45, 0\], not \[from, to\]"),
        ("size_mm = [0, 45]", "firmness = [55, 1010]", "line 6: firmness is .* <= 100"),
        ("bruised = false", 'bruised = "no"', "line 12: bruised is 'no', not true or false"),
        ("confidence = 0.9", "confidence = 0.4", "line 13: confidence is 0.4, .* at least 0.5"),
        ('["kiwi", "lime"]', "[1]", r"line 5: class is \[1\], not a name"),
        ("[0, 45]", "[0, 45", "Unclosed array"),
        ("default =", "most_grasps = 0\ndefault =", "line 1: most_grasps is 0, .* from 1 to 20"),
        ("default =", "require_item = 1\ndefault =", "line 1: require_item is 1, not true or"),
        (GOOD, 'default = "x"\n[[rule]]\nbin = "y"', "line 2: this rule has no condition"),
        (GOOD, 'default = "x"\n', r"has no \[\[rule\]\]"),
        (GOOD, 'default = "x"\nrule = []', r"has no \[\[rule\]\]"),
        (GOOD, 'default = "x"\nrule = [1]', r"has no \[\[rule\]\]"),
        (GOOD, 'default = "x"\nrule = {}', r"has no \[\[rule\]\]"),
    ],
)
def test_read_rules_mistake_raises_one_line_with_line_number(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(InputError, match=rf"rules\.toml.*{message}") as caught:
        read(tmp_path, GOOD.replace(old, new))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ('class = ["kiwi", "lime"]', 'class = "kiwi"', "line 5: this rule never applies.*line 2"),
        ("size_mm = [0, 60]", "size_mm = [10, 60]", "line 5: this rule never applies.*line 2"),
        ('class = "kiwi"', 'class = "kiwi"\nbruised = true', "line 5: this rule never applies"),
        (
            'class = "kiwi"\nsize_mm = [0, 50]',
            'class = "kiwi"\nsize_mm = [40, 90]',
            "overlaps the rule on line 2 with a different bin .class kiwi, size_mm 40 to 50",
        ),
        ("bruised = true", 'class = "kiwi"', None),
        ("size_mm = [0, 50]", "size_mm = [50, 90]", None),
        ('class = "kiwi"', 'class = ["kiwi", "lime"]', None),
        ('class = "kiwi"\nconfidence = 0.95', 'class = "kiwi"\nconfidence = 0.6', None),
        ('class = "kiwi"\nsize_mm = [0, 50]', 'class = "lime"\nsize_mm = [40, 90]', None),
        ("firmness = [0, 40]", "size_mm = [0, 60]", None),
    ],
)
def test_read_rules_refuses_only_unreachable_and_partly_overlapping_rules(
    tmp_path: Path, first: str, second: str, message: str | None
) -> None:
    if message is None:
        assert len(read_two(tmp_path, first, second).rules) == 2
        return
    with pytest.raises(InputError, match=message):
        read_two(tmp_path, first, second)


def test_rules_file_in_another_encoding_is_refused_with_the_place(tmp_path: Path) -> None:
    (tmp_path / "rules.toml").write_bytes('default = "Früchte"\n'.encode("latin-1"))
    with pytest.raises(InputError, match="not UTF-8 at byte 13; save it as UTF-8"):
        read_rules(tmp_path / "rules.toml")


def test_check_kinds_class_without_labels_raises(tmp_path: Path) -> None:
    book = read(tmp_path, GOOD)
    with pytest.raises(InputError, match=r"line 8: class 'avocado' has fewer than 3 .*kiwi, lime"):
        check_kinds(book, known_kinds={"kiwi", "lime"}, path="rules.toml")
    check_kinds(book, known_kinds={"kiwi", "lime", "avocado"}, path="rules.toml")
