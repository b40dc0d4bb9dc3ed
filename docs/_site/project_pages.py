"""Pages of the site whose texts lie elsewhere in the repository, and links that lead out of docs/.

Texts are written for a hosting platform, where links are paths of files. On the site a link to one of
`PAGES` leads to its page, one to a script of the gallery to the page that shows it.
"""

import re
from os.path import normpath, relpath
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PAGES = {
    "README.md": "generated/readme.md",
    "CONTRIBUTING.md": "generated/project/contributing.md",
    "CHANGELOG.md": "generated/project/changelog.md",
    "SECURITY.md": "generated/project/security.md",
    "CODE_OF_CONDUCT.md": "generated/project/code_of_conduct.md",
    "RELEASING.md": "generated/project/releasing.md",
    "benchmarks/cycles/README.md": "generated/cycles.md",
    "integrations/blender/README.md": "generated/blender.md",
}
CHILDREN = {"decisions/README": "0*"}  # pages below a page, besides those of docs/index.md
_LINK = re.compile(r"(?<=\]\()([^)\s#:]+)(?=[)#])")


def relinked(text: str, source: str, page: str) -> str:
    """Text of the file `source` (path in the repository) as the page `page` (path in docs/)."""

    def to(match: re.Match[str]) -> str:
        target = normpath(f"{Path(source).parent}/{match[1]}")
        if target in PAGES:
            target = PAGES[target]
        elif target.startswith("docs/gallery/") and target.endswith(".py"):
            target = f"generated/gallery/{Path(target).stem}.rst"
        elif target.startswith("docs/"):
            target = target.removeprefix("docs/")
        else:
            target = f"../{target}"
        return relpath(target, Path(page).parent)

    return _LINK.sub(to, text)


def _write_pages(app: Any) -> None:
    for source, page in PAGES.items():
        path = Path(app.srcdir) / page
        if (ROOT / source).exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            text = relinked((ROOT / source).read_text(encoding="utf-8"), source, page)
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                path.write_text(text, encoding="utf-8")


def _relink(app: Any, docname: str, content: list[str]) -> None:
    if not docname.startswith("generated/") and (ROOT / "docs" / f"{docname}.md").exists():
        content[0] = relinked(content[0], f"docs/{docname}.md", f"{docname}.md")
        if docname in CHILDREN:
            content[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n\n{CHILDREN[docname]}\n```\n"


def _label_captions(
    app: Any, page: str, template: str, context: dict[str, Any], document: Any
) -> None:
    """The theme marks captions of its navigation as headings, without their level."""
    tree = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = tree.replace(
        'role="heading"', 'role="heading" aria-level="2"'
    )


def setup(app: Any) -> dict[str, bool]:
    """For Sphinx."""
    app.connect("builder-inited", _write_pages)
    app.connect("source-read", _relink)
    app.connect("html-page-context", _label_captions, priority=900)  # after the theme
    return {"parallel_read_safe": True, "parallel_write_safe": True}
