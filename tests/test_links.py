"""Links of README.md and docs/ lead somewhere for those who read them in the repository, where nothing is built."""

from __future__ import annotations

import re
from pathlib import Path

from tests.tables import over

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_" not in path.parent.name)]

MADE_WITH_THE_SITE = {"json-output.schema.json"}
"""Files that a build of the site writes beside the page; a fresh copy of the repository lacks them."""

_LINK = re.compile(r"\[([^\]\n]*(?:\n[^\]\n]+)?)\]\(([^)\s]+)\)")


@over("page", PAGES)
def test_links_have_a_text_and_lead_somewhere(page: Path) -> None:
    for text, target in _LINK.findall(
        re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    ):
        assert text, target
        path, _, heading = target.partition("#")
        if "://" in target:
            continue
        aim = page.parent / path if path else page
        assert aim.exists() or target in MADE_WITH_THE_SITE, target
        assert not heading or heading in anchors(aim), target


def anchors(page: Path) -> set[str]:
    """Return the anchors that a repository's web page makes of the headings of `page`; a second one ends in -1."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    plain = [re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings]
    return {f"{name}-{plain[:at].count(name)}" if name in plain[:at] else name for at, name in enumerate(plain)}
