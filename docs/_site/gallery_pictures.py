"""Pictures of the gallery's pages: those that the scripts write, or those that lie next to them."""

import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image, ImageOps
from sphinx_gallery.scrapers import figure_rst

_FOLDER = Path(tempfile.gettempdir()) / "blurmatte-gallery"
_END = re.compile(r"^\.\. _sphx_glr_download_", re.MULTILINE)


def arguments(gallery: dict[str, Any], script: dict[str, Any]) -> list[str]:
    """Arguments of a script: the folder into which `figure.save` writes."""
    folder = _FOLDER / Path(script["src_file"]).stem
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return [str(folder)]


def scraper(block: object, variables: dict[str, Any], gallery: dict[str, Any]) -> str:
    """The picture that the last cell wrote, as a directive; empty if it wrote none."""
    page = Path(variables["src_file"]).stem
    target = []
    for picture in (_FOLDER / page).glob("*.jpg"):
        target.append(str(Path(next(variables["image_path_iterator"])).with_suffix(".jpg")))
        shutil.move(picture, target[-1])
    return figure_rst(target, gallery["src_dir"], f"What {page}.py writes") if target else ""


def _draw_thumbnails(app: Any) -> None:
    """Reduced pictures for the overview, where scripts are not run."""
    size = app.config.sphinx_gallery_conf["thumbnail_size"]
    for picture in (Path(app.srcdir) / "gallery").glob("*.jpg"):
        target = Path(app.srcdir) / "generated/gallery/images/thumb"
        with Image.open(picture) as sheet:
            thumbnail = ImageOps.pad(sheet, size, color="white")
        thumbnail.save(target / f"sphx_glr_{picture.stem}_thumb.png")


def _show_picture(app: Any, docname: str, content: list[str]) -> None:
    """Where a script was not run, the picture that lies next to it."""
    name = Path(docname).name
    if (
        docname == f"generated/gallery/{name}"
        and name != "index"
        and "images/sphx" not in content[0]
    ):
        image = f".. image:: /gallery/{name}.jpg\n   :alt: What {name}.py writes\n\n"
        content[0] = _END.sub(lambda end: image + end[0], content[0], count=1)


def setup(app: Any) -> dict[str, bool]:
    """For Sphinx."""
    app.connect("builder-inited", _draw_thumbnails, priority=900)
    app.connect("source-read", _show_picture)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
