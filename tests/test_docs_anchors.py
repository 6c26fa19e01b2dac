"""Every link to a heading, within a page or in another one: that heading is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CHANGELOG.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("ros2/**/*.md")]
)
LINK = re.compile(r"\]\(([^)#\s]*)#([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Of each heading, as GitHub and GitLab make them: small letters, words joined by dashes."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_headings_lead_somewhere(page):
    links = LINK.findall(page.read_text(encoding="utf-8"))
    links = [(file, anchor) for file, anchor in links if "://" not in file]
    lost = [
        f"{file}#{anchor}"
        for file, anchor in links
        if anchor not in anchors(page.parent / file if file else page)
    ]
    assert lost == []


def test_an_anchor_is_made_as_on_github(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# The picture's own pixels\n\n```sh\n# no heading\n```\n\n## PX4: `a.csv`\n", "utf-8")
    assert anchors(page) == {"the-pictures-own-pixels", "px4-acsv"}
