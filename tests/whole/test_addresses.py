"""Addresses, which several files repeat for their readers, agree."""

from __future__ import annotations

import tomllib

import yaml
from tests.pages import ROOT


def test_site_and_citation_have_addresses_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    urls = project["urls"]
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert site["site_url"] == citation["url"] == urls["Documentation"]
    assert site["repo_url"] == citation["repository-code"] == urls["Repository"]
