"""What the README shows must run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("snippet", SNIPPETS, ids=["grasp", "settle"])
def test_snippet_runs_and_says_something(snippet: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(snippet, "README.md", "exec"), {})
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("verb", sorted(set(re.findall(r"(?:`|\n|&& )palpate ([a-z]+)", README))))
def test_every_verb_it_names_exists(verb: str) -> None:
    from palpate.cli import VERBS

    assert verb in VERBS


@pytest.mark.parametrize(
    "study", sorted(set(re.findall(r"palpate study ([a-z][a-z0-9-]+)", README)))
)
def test_every_study_it_names_exists(study: str) -> None:
    from palpate.commands.research import catalogue
    from palpate.commands.study import GROUP

    assert study in catalogue(GROUP)


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_every_link_leads_to_a_file(target: str) -> None:
    assert (ROOT / target).exists()
