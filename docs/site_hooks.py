"""Hooks of MkDocs: pages and pictures that lie outside docs/ join the site, links find them, equations become MathML.

So a page asks no other server for anything. Links to other files lead to the repository where its name is known
(GITHUB_REPOSITORY), and are plain text elsewhere.
"""

from __future__ import annotations

import os
import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "experiments/README.md": "experiments.md",
    "experiments/bench/README.md": "benchmarks.md",
    "experiments/dds_testbed/README.md": "testbed.md",
}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_EQUATION = re.compile(r"\$\$\n(.+?)\n\$\$|\$([^$\n]+)\$", re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds what lies outside docs/."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    for picture in sorted((ROOT / "experiments").rglob("results/*.png")):
        files.append(File.generated(config, _picture(picture.relative_to(ROOT)), abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Points each relative link of a page to where its target is on the site."""
    here = page.file.src_uri
    source = next((path for path, site in PAGES.items() if site == here), f"docs/{here}")
    if here == "model.md":
        markdown = _EQUATION.sub(_mathml, markdown)
    return _LINK.sub(lambda found: _moved(found, source, here), markdown)


def _mathml(found: re.Match[str]) -> str:
    display, inline = found.groups()
    equation = convert(" ".join((display or inline).split()), display="block" if display else "inline")
    return f'<div style="margin: 1em 0; overflow-x: auto">{equation}</div>' if display else equation


def _moved(found: re.Match[str], source: str, here: str) -> str:
    mark, text, link = found.groups()
    if re.match(r"[a-z]+:|#", link):
        return found[0]
    target, hash_, anchor = link.partition("#")
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
    site = _on_site(path)
    if site is None:
        repository = os.environ.get("GITHUB_REPOSITORY")
        return f"{mark}[{text}](https://github.com/{repository}/blob/main/{path})" if repository else text
    return f"{mark}[{text}]({posixpath.relpath(site, posixpath.dirname(here) or '.')}{hash_}{anchor})"


def _on_site(path: str) -> str | None:
    """Where a file of the repository lies on the site, if it does."""
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/") and Path(path).suffix in (".md", ".png"):
        return path.removeprefix("docs/")
    if path.startswith("experiments/") and path.endswith(".png") and (ROOT / path).is_file():
        return _picture(Path(path))
    return None


def _picture(path: Path) -> str:
    return f"pictures/{'-'.join(path.parts)}"
