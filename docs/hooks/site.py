"""What the site adds to ``docs``: pages that the code tells, pages from the repository's root, links between them."""

import logging
import os
import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))

import notebooks
import reference

ROOT = reference.ROOT
FROM_ROOT = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "LICENSE": "licence.md",
}
"""Files of the repository's root that are pages, and what they are called there."""
ELSEWHERE = {
    "aerodft/conventions.py": "concepts/conventions.md",
    "docs/decisions": "decisions/index.md",
    "aerodft/model/status.py": "reference/statuses.md",
    "docs/schema": "reference/schemas.md",
    "configs/cameras": "reference/examples.md",
    **{f"docs/notebooks/{path.name}": f"notebooks/{path.stem}.md" for path in notebooks.FOLDER.glob("*.py")},
}
"""What a link to something that is no page becomes."""

_LINK = re.compile(r"(!?\[[^\]]*\]\()([^)#:\s]+)(#[^)]*)?(\))")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    logging.getLogger("matplotlib").setLevel(logging.WARNING)
    for path, content in (*reference.pages().items(), *notebooks.pages()):
        files.append(File.generated(config, path, content=content))
    for name, path in FROM_ROOT.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, path, content=text if name.endswith(".md") else f"```text\n{text}```\n"))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001 - mkdocs's own signature
    """Have links that are right in the repository be right in the site."""
    here = page.file.src_uri
    source = next((name for name, path in FROM_ROOT.items() if path == here), f"docs/{here}")

    def linked(match: re.Match[str]) -> str:
        before, target, anchor, after = match.groups(default="")
        path = os.path.normpath(os.path.join(os.path.dirname(source), target))  # noqa: PTH118, PTH120 - of text
        return (
            f"{before}{os.path.relpath(_in_site(path), os.path.dirname(here) or '.')}{anchor or _anchor(path)}{after}"  # noqa: PTH120
        )

    return _LINK.sub(linked, markdown)


def _in_site(path: str) -> str:
    """Where in the site a file of the repository is; what is nowhere stays, so that the build refuses it."""
    known = FROM_ROOT | ELSEWHERE
    if path in known:
        return known[path]
    if path.startswith("configs/") and (ROOT / path).is_file():
        return "reference/examples.md"
    return path.removeprefix("docs/")


def _anchor(path: str) -> str:
    is_example = path.startswith("configs/") and (ROOT / path).is_file()
    return f"#{Path(path).parent.name}-{Path(path).stem}" if is_example else ""
