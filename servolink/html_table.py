"""Tables in HTML, which notebooks show in place of an object's text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from servolink.escaping import escape


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table. What stands in it may be hostile: it is escaped for HTML, and hidden characters are shown."""
    from html import escape as escape_html  # late: few programs run in notebooks

    def row(cells: Sequence[object], tag: str) -> str:
        return f"<tr>{''.join(f'<{tag}>{escape_html(escape(str(cell)))}</{tag}>' for cell in cells)}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    title = f"<caption>{escape_html(escape(caption))}</caption>" if caption else ""
    return f"<table>{title}{row(columns, 'th')}{body}</table>"
