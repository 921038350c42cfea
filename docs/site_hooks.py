"""What mkdocs does beside its own: pages of the repository outside docs/, and new pages.

The pages are written to be read in the repository too: they link to README files, examples and
CONTRIBUTING.md as they lie there. Such files become pages of the site under `repository/`, and
links to them are rewritten.
"""

from __future__ import annotations

import importlib.util
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

DOCS = Path(__file__).parent
ROOT = DOCS.parent
_LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)\s]*)?(\))")
_OUTSIDE = "repository"


def on_config(config: Any) -> Any:
    """Sections get the pages that the nav does not name: decisions, and pages that are new."""
    named = set(re.findall(r"[\w/.-]+\.md", str(config.nav)))
    new = sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))
    for section in config.nav:
        ((title, pages),) = section.items()
        folder = {"Decisions": "adr/", "Guide": "guide/", "Reference": "reference/"}.get(title)
        if folder:
            pages += [page for page in new if page.startswith(folder) and page not in named]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Adds the files outside docs/ that pages link to, directly or through others."""
    waiting = [*DOCS.rglob("*.md")]
    seen = set(waiting)
    while waiting:
        page = waiting.pop()
        for match in _LINK.finditer(page.read_text(encoding="utf-8")):
            target = _target(page, match[2])
            if target is None or target in seen:
                continue
            seen.add(target)
            if not target.is_relative_to(DOCS):
                files.append(File.generated(config, _uri(target), abs_src_path=str(target)))
            if target.suffix == ".md":
                waiting.append(target)
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Rewrites links that lead out of docs/, or back from there."""
    source = Path(page.file.abs_src_path)
    here = posixpath.dirname(page.file.src_uri)

    def rewritten(match: re.Match[str]) -> str:
        target = _target(source, match[2])
        if target is None:
            return match[0]
        return f"{match[1]}{posixpath.relpath(_uri(target), here)}{match[3] or ''}{match[4]}"

    if page.file.src_uri == "reference/commands.md":
        markdown += "\n" + _commands_page()
    return _LINK.sub(rewritten, markdown)


def _commands_page() -> str:
    # mkdocs loads this file by its path: its folder is not where modules are looked for.
    spec = importlib.util.spec_from_file_location("commands_page", DOCS / "commands_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text: str = module.commands_page()
    return text


def _target(page: Path, link: str) -> Path | None:
    """The file of the repository that a link of a page means; of a folder its README."""
    if "://" in link or link.startswith("mailto:"):
        return None
    target = (page.parent / link).resolve()
    if target.is_dir():
        target /= "README.md"
    return target if target.is_file() and target.is_relative_to(ROOT) else None


def _uri(target: Path) -> str:
    if target.is_relative_to(DOCS):
        return target.relative_to(DOCS).as_posix()
    name = target.relative_to(ROOT).as_posix()
    # A README would become the index of a folder, beside a file of the same name.
    return f"{_OUTSIDE}/{name}"
