"""Rules files: reading, and a one-line error for each mistake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate.produce.sorting.conditions import OneOf, Within
from palpate.produce.sorting.rules_file import check_kinds, read_rules

ROOT = Path(__file__).resolve().parents[3]
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


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def write_file(text: str) -> Path:
        path = tmp_path / "rules.toml"
        path.write_text(text)
        return path

    return write_file


def test_read_rules_preserves_order_and_conditions(write: Callable[[str], Path]) -> None:
    book = read_rules(write(GOOD))
    assert book.bins == ("small", "ripe", "by hand")
    assert book.most_grasps == 3
    small, ripe = book.rules
    fruit = OneOf("class", frozenset({"kiwi", "lime"}))
    assert small.conditions == (fruit, Within("size_mm", 0, 45))
    assert (small.confidence, small.line) == (0.8, 3)
    avocados = OneOf("class", frozenset({"avocado"}))
    assert ripe.conditions == (
        avocados,
        OneOf("ripeness", frozenset({"ripe"})),
        OneOf("bruised", frozenset({"false"})),
    )
    assert ripe.confidence == 0.9


def test_read_rules_accepts_the_example_file() -> None:
    book = read_rules(ROOT / "examples" / "sorting-rules.toml")
    assert "eggs" in book.bins
    assert book.default_bin == "by hand"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'class = "avocado"',
            'clas = "avocado"',
            "line 10: unknown key 'clas'; choose one of: bin, cl",
        ),
        ('default = "by hand"', "", "line 1: has no default"),
        ('bin = "ripe"', "", "line 8: this rule has no bin"),
        ("[0, 45]", "[45, 0]", r"line 6: size_mm is \[45, 0\], not \[from, to\]"),
        ("bruised = false", 'bruised = "no"', "line 12: bruised is 'no', not true or false"),
        (
            "confidence = 0.9",
            "confidence = 0.4",
            "line 13: confidence is 0.4, not a number of at least 0.5",
        ),
        ('["kiwi", "lime"]', "[1]", r"line 5: class is \[1\], not a name"),
        ("[0, 45]", "[0, 45", "Unclosed array"),
        (
            "default =",
            "most_grasps = 0\ndefault =",
            "line 1: most_grasps is 0, not a whole number from 1 to 20",
        ),
    ],
)
def test_read_rules_mistake_raises_one_line_with_line_number(
    write: Callable[[str], Path],
    old: str,
    new: str,
    message: str,
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_rules(write(GOOD.replace(old, new)))
    assert "\n" not in str(caught.value)
    assert "rules.toml" in str(caught.value)


def test_read_rules_without_rules_or_conditions_raises(write: Callable[[str], Path]) -> None:
    for rules in ("", "rule = []", "rule = [1]", "rule = {}"):
        with pytest.raises(InputError, match=r"has no \[\[rule\]\]"):
            read_rules(write(f'default = "x"\n{rules}'))
    with pytest.raises(InputError, match="line 2: this rule has no condition"):
        read_rules(write('default = "x"\n[[rule]]\nbin = "y"'))


def test_read_rules_missing_file_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_rules(tmp_path / "none.toml")


def rule(bin_name: str, conditions: str) -> str:
    return f'[[rule]]\nbin = "{bin_name}"\n{conditions}\n'


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ('class = ["kiwi", "lime"]', 'class = "kiwi"'),
        ("size_mm = [0, 60]", "size_mm = [10, 60]"),
        ('class = "kiwi"', 'class = "kiwi"\nbruised = true'),
    ],
)
def test_read_rules_unreachable_rule_raises(
    write: Callable[[str], Path], first: str, second: str
) -> None:
    text = 'default = "x"\n' + rule("a", first) + rule("b", second)
    with pytest.raises(InputError, match=r"line 5: this rule never applies.*line 2"):
        read_rules(write(text))


def test_read_rules_partial_overlap_raises(write: Callable[[str], Path]) -> None:
    small, large = ('class = "kiwi"\nsize_mm = ' + sizes for sizes in ("[0, 50]", "[40, 90]"))
    common = "overlaps the rule on line 2 with a different bin .class kiwi, size_mm 40 to 50"
    with pytest.raises(InputError, match=common):
        read_rules(write('default = "x"\n' + rule("a", small) + rule("b", large)))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("bruised = true", 'class = "kiwi"'),
        ("size_mm = [0, 50]", "size_mm = [50, 90]"),
        ('class = "kiwi"', 'class = ["kiwi", "lime"]'),
        ('class = "kiwi"\nconfidence = 0.95', 'class = "kiwi"\nconfidence = 0.6'),
        ('class = "kiwi"\nsize_mm = [0, 50]', 'class = "lime"\nsize_mm = [40, 90]'),
        ("firmness = [0, 40]", "size_mm = [0, 60]"),
    ],
)
def test_read_rules_accepts_exceptions_and_separate_conditions(
    write: Callable[[str], Path], first: str, second: str
) -> None:
    text = 'default = "x"\n' + rule("a", first) + rule("b", second)
    assert len(read_rules(write(text)).rules) == 2


def test_check_kinds_class_without_labels_raises(write: Callable[[str], Path]) -> None:
    book = read_rules(write(GOOD))
    with pytest.raises(InputError, match=r"line 8: class 'avocado' has fewer than 3 .*kiwi, lime"):
        check_kinds(book, known_kinds={"kiwi", "lime"}, path="rules.toml")
    check_kinds(book, known_kinds={"kiwi", "lime", "avocado"}, path="rules.toml")
