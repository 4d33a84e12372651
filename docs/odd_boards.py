"""The table of docs/reference/odd-boards.md, made from the declarations of odd boards.

`python -m docs.odd_boards` writes it anew; the text around the table is written by hand.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from tests.lab.odd.kinds import KINDS

PAGE = Path(__file__).parent / "reference/odd-boards.md"

_TABLE = re.compile(r"(?s)(?<=<!-- kinds -->\n).*?(?=<!-- end -->)")


def with_table(page: str) -> str:
    """Return the page with the table as the declarations are now."""
    rows = "".join(f"| `{name}` | {inspect.getdoc(kind)} | {kind.lesson} |\n" for name, kind in KINDS.items())
    return _TABLE.sub(lambda _: f"| kind | board | lesson |\n|---|---|---|\n{rows}", page)


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
