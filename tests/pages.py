"""The pages of documentation, as several files of tests read them."""

from __future__ import annotations

import re
from pathlib import Path


def blocks(page: Path, language: str = "python|sh") -> list[tuple[int, str, str]]:
    """Line number, language and text of every fenced block of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(rf"^```({language})\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    return [(text.count("\n", 0, match.start(2)) + 1, match[1], match[2]) for match in found]
