"""Repairs to the theme's HTML for those who do not see well: landmarks, captions, tables, signatures.

`tests/test_site.py` has axe-core look at the result.
"""

from __future__ import annotations

import re

_REPAIRS = (
    ('<p class="caption" role="heading">', '<p class="caption" role="heading" aria-level="2">'),
    ('<aside class="sidebar-drawer"', '<aside class="sidebar-drawer" aria-label="Pages"'),
    ('<th class="head"><p></p></th>', '<td class="head"></td>'),
    ('<aside class="toc-drawer', '<aside aria-label="This page" class="toc-drawer'),
)
_PARAMETERS = re.compile(r"<dl>\n(.*?)</dl>", re.DOTALL)


def accessible(html: str) -> str:
    """Return the body of a page, repaired."""
    for old, new in _REPAIRS:
        html = html.replace(old, new)
    return _PARAMETERS.sub(_parameters, html)


def _parameters(found: re.Match[str]) -> str:
    """Return the parameters of a long signature as lines: Sphinx makes a list of definitions without terms of them."""
    lines = found[1].replace("<dd>", '<span class="sig-line">').replace("</dd>", "</span>")
    return f'<span class="sig-lines">{lines}</span>'
