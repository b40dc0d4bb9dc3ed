"""Check a built site: links, and with a browser requests, width and accessibility of every page.

python scripts/check_site.py build/site [--browser] [--pages GLOB] [--pictures FOLDER]
"""

import argparse
import functools
import shutil
import sys
import threading
from collections.abc import Iterator
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

PHONE, DESK = 390, 1280  # pixels
_SIZES = {"phone": (PHONE, 844), "desk": (DESK, 800)}
# Pixels by which the content of a box that scrolls is wider than it: the theme has one inside the page.
_EXCESS = """() => {
  let excess = 0;
  for (let box = document.querySelector("article") ?? document.body; box; box = box.parentElement)
    if (getComputedStyle(box).overflowX !== "visible")
      excess = Math.max(excess, box.scrollWidth - box.clientWidth);
  return excess;
}"""


class _Page(HTMLParser):
    """Targets and places of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []  # where links lead
        self.loaded: list[str] = []  # what a browser fetches
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note links, files and places."""
        found = {name: value for name, value in attrs if value}
        self.places |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.targets.append(found["href"])
        elif tag == "link" and "href" in found:
            self.loaded.append(found["href"])
        elif "src" in found:
            self.loaded.append(found["src"])


def broken_links(folder: Path) -> tuple[list[str], set[str]]:
    """Links of a site that lead nowhere, and those that lead out of it."""
    pages = {
        path: _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))
    }
    broken, outside = [], set()
    for path, page in pages.items():
        for link in page.targets + page.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                outside.add(link)
                if link in page.loaded and parts.scheme != "data":
                    broken.append(f"{path.relative_to(folder)}: loads {link}")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            known = pages.get(target)
            if not target.exists() or (place and known and place not in known.places):
                broken.append(f"{path.relative_to(folder)}: {link}")
    return broken, outside


class _Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Print nothing."""


def seen(folder: Path, pages: str, pictures: Path | None) -> Iterator[str]:
    """Faults that a browser shows: requests to other hosts, width, accessibility on a desk's screen."""
    from axe_core_python.sync_playwright import Axe
    from playwright.sync_api import sync_playwright

    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(_Silent, directory=str(folder))
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    home = f"http://127.0.0.1:{server.server_port}/"
    program = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program)
        for scheme in ("light", "dark"):
            for size, (width, height) in _SIZES.items():
                context = browser.new_context(
                    viewport={"width": width, "height": height}, color_scheme=scheme
                )
                page = context.new_page()
                asked: list[str] = []
                page.on("request", lambda request, asked=asked: asked.append(request.url))
                for path in sorted(folder.glob(pages)):
                    name = path.relative_to(folder).as_posix()
                    page.goto(urljoin(home, name))
                    where = f"{name} ({scheme}, {size})"
                    yield from (f"{where}: asks {url}" for url in asked if not _own(url, home))
                    asked.clear()
                    excess = page.evaluate(_EXCESS)
                    if excess > 0:
                        yield f"{where}: {excess} pixels too wide"
                    if size == "desk":
                        for fault in Axe().run(page)["violations"]:
                            first = fault["nodes"][0]["html"][:120]
                            yield f"{where}: {fault['id']}, {len(fault['nodes'])} times: {first}"
                    if pictures is not None:
                        pictures.mkdir(parents=True, exist_ok=True)
                        page.screenshot(
                            path=pictures / f"{name.replace('/', '_')}_{scheme}_{size}.png"
                        )
                context.close()
        browser.close()
    server.shutdown()


def _own(url: str, home: str) -> bool:
    return url.startswith((home, "data:", "blob:"))


def main() -> int:
    """Print what is wrong; 1 if anything is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--browser", action="store_true", help="open every page in Chromium")
    parser.add_argument("--pages", default="**/*.html", help="those that the browser opens")
    parser.add_argument("--pictures", type=Path, help="where to write what the browser shows")
    given = parser.parse_args()
    folder = given.folder.resolve()
    faults, outside = broken_links(folder)
    if given.browser:
        faults += seen(folder, given.pages, given.pictures)
    print(*sorted(outside), sep="\n")
    print(*faults, sep="\n", file=sys.stderr)
    print(f"{len(list(folder.rglob('*.html')))} pages, {len(faults)} faults")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
