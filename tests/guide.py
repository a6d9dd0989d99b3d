"""The law in CONTRIBUTING's guide, as a module."""

from __future__ import annotations

import re
from pathlib import Path

GUIDE = Path(__file__).parents[1] / "CONTRIBUTING.md"


def write_guide(folder: Path) -> Path:
    """Writes it to `lab.py` in a folder."""
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    file = folder / "lab.py"
    file.write_text(code, encoding="utf-8")
    return file
