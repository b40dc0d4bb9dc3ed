"""The README as the page of the package: its links and its picture lead to the repository.

The address is `Source` in `[project.urls]` of pyproject.toml. Until it is set, links to files are plain
text there and the picture is left out, as relative ones would lead nowhere.
"""

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

_PICTURE = re.compile(r"!\[[^]]*\]\((?!https?:)([^)]+)\)\n*")
_LINK = re.compile(r"\[([^]]+)\]\((?!https?:|#)([^)]+)\)")


class CustomMetadataHook(MetadataHookInterface):
    """Sets `readme`."""

    def update(self, metadata: dict) -> None:
        """Add the text of the page to the metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        address = metadata.get("urls", {}).get("Source")
        page = package_page(text, address, metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": page}


def package_page(text: str, address: str | None, version: str) -> str:
    """Markdown whose links to files of the repository are absolute, those of a version's tag."""
    if address is None:
        return _LINK.sub(r"\1", _PICTURE.sub("", text))
    address = address.rstrip("/")
    text = _PICTURE.sub(
        lambda found: found[0].replace(f"({found[1]})", f"({address}/raw/v{version}/{found[1]})"),
        text,
    )
    return _LINK.sub(rf"[\1]({address}/blob/v{version}/\2)", text)
