"""Door: the page in a browser, from dropping files to downloads. Needs Chromium."""

import csv
import hashlib
import io
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("starlette", reason="needs the extra ui")
pytest.importorskip("playwright", reason="needs playwright")
from playwright.sync_api import Browser, Page, expect, sync_playwright
from tests.scenes import on_line
from tests.ui.programs import helpers, wait_for

import blurmatte as bm
from blurmatte.rendering import Ball, Camera, Shot, colorful_plate

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plain"
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")

SECONDS = 60_000  # milliseconds of patience, on a busy machine
expect.set_options(timeout=SECONDS)
GRAPHICS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium, which draws without a graphics card."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=GRAPHICS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[subprocess.Popen]:
    """A server, its address and the folder of its temporary files."""
    folder = tmp_path_factory.mktemp("served")
    line = [sys.executable, "-m", "blurmatte", "ui", "--no-browser"]
    environment = os.environ | {"TMPDIR": str(folder)}
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        process.address, process.folder = process.stdout.readline().strip(), folder
        yield process
        process.send_signal(signal.SIGINT)
        process.wait(20)
    assert list(folder.glob("blurmatte-*")) == []


@pytest.fixture(scope="module")
def address(server) -> str:
    """Of a page that is served."""
    return server.address


def opened(browser: Browser, address: str, scheme: str = "light") -> Page:
    """A page that reaches no other host."""
    host = address.partition("/#")[0]
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, color_scheme=scheme, accept_downloads=True
    )
    context.set_default_timeout(SECONDS)
    page = context.new_page()
    page.foreign, page.faults = [], []

    def only_here(route, request):
        if request.url.startswith((host, "blob:")):
            route.continue_()
        else:
            page.foreign.append(request.url)
            route.abort()

    page.route("**/*", only_here)
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.goto(address)
    return page


@pytest.fixture(scope="module")
def solved(browser, address) -> Page:
    """The example, dropped and solved."""
    page = opened(browser, address)
    page.get_by_label("Picture or clip").set_input_files(EXAMPLE / "image.png")
    page.get_by_label("Plate", exact=True).set_input_files(EXAMPLE / "plate.png")
    page.get_by_text("1: 190 × 116 pixels").wait_for()
    page.get_by_role("button", name="Solve", exact=True).click()
    page.locator(".grade").wait_for()
    return page


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """A white ball before a gray wall, which two brightnesses explain, and a clip of an orange one."""
    folder = tmp_path_factory.mktemp("scene")
    camera = Camera(code_std=1 / 255)
    y, x = np.mgrid[:72, :96]
    wall = np.repeat(0.3 + 0.03 * (np.sin(x / 17) + np.cos(y / 13))[..., None], 3, axis=2)
    for name, plate, color, count in (
        ("white", wall.astype(np.float32), (0.95, 0.95, 0.95), 1),
        ("clip", colorful_plate((96, 72), 2, tile=18), (0.9, 0.4, 0.05), 4),
    ):
        shots = []
        for k in range(count):
            truth = on_line(
                plate, (26 + 12 * k, 28), (70 - 22 * (count > 1) + 12 * k, 42), Ball(9, color=color)
            )
            shots.append(Shot(truth.scene, camera).photograph(truth))
        bm.write(folder / f"{name}.png", shots[0][0])
        bm.write(folder / f"{name}_plate.png", shots[0][1])
        if count > 1:
            bm.write_frames(folder / f"{name}.mov", [image for image, _ in shots], 25)
    return folder


@pytest.fixture(scope="module")
def doubtful(browser, address, scene) -> Page:
    """The white ball, solved; more than one color fits."""
    page = opened(browser, address)
    page.get_by_label("Picture or clip").set_input_files(scene / "white.png")
    page.get_by_label("Plate", exact=True).set_input_files(scene / "white_plate.png")
    page.get_by_role("button", name="Solve", exact=True).click()
    page.locator(".grade").wait_for()
    return page


def drawn(page: Page) -> np.ndarray:
    """The codes of the canvas, when all tiles have come."""
    page.locator("canvas[data-complete=true]").first.wait_for()
    return np.asarray(
        Image.open(io.BytesIO(page.locator("canvas").first.screenshot())).convert("RGB")
    )


def at_1_1(page: Page, width: int, height: int) -> np.ndarray:
    """The picture as it is drawn, a pixel of the screen for each of its own."""
    page.get_by_role("button", name="1:1").click()
    group = page.locator(".overlay g")
    expect(group).to_have_attribute("transform", re.compile(r"scale\(1\)"))
    x, y = (
        round(float(v))
        for v in re.findall(r"translate\((\S+) (\S+)\)", group.get_attribute("transform"))[0]
    )
    return drawn(page)[y : y + height, x : x + width]


def test_the_status_begins_with_the_grade(solved):
    assert solved.get_by_role("status").inner_text().startswith("plausible: alpha within")
    line = solved.get_by_role("group", name="Command").inner_text()
    assert "blurmatte solve image.png --plate plate.png" in line


def test_layer_has_the_bytes_of_the_shown_command(solved, tmp_path):
    with solved.expect_download() as download:
        solved.get_by_role("button", name="Download layer.exr").click()
    got = Path(download.value.path()).read_bytes()
    for name in ("image.png", "plate.png"):
        shutil.copy(EXAMPLE / name, tmp_path)
    shown = solved.get_by_role("group", name="Command").locator("code").inner_text().split()
    subprocess.run([sys.executable, "-m", *shown], cwd=tmp_path, check=True, capture_output=True)
    (layer,) = tmp_path.rglob("layer.exr")
    assert layer.read_bytes() == got


def test_changes_are_drawn_as_the_command_writes_them(solved):
    solved.get_by_role("tab", name="Edit").click()
    seen = []
    solved.on("request", lambda request: seen.append(request.url))
    solved.get_by_role("slider", name="Fade").fill("0.4")
    solved.get_by_role("slider", name="Expose").fill("0.5")
    for number, paint in ((2, "#ffffff"), (3, "#2040ff")):
        solved.get_by_role("button", name="It has another paint").click()
        solved.get_by_label(f"Paint {number} of the object").fill(paint)
    solved.get_by_label("New color of paint 2").fill("#20ff80")
    drawn(solved)
    assert not [url for url in seen if "/api/" in url and "pixels" not in url]
    shown = at_1_1(solved, 400, 300).astype(int)
    solved.get_by_role("button", name="Write the changed picture").click()
    with solved.expect_download() as download:
        solved.get_by_role("button", name="Download changed.png").click()
    written = np.asarray(Image.open(download.value.path()).convert("RGB")).astype(int)
    assert np.abs(shown - written).max() <= 1
    assert (
        np.abs(
            written - np.asarray(Image.open(EXAMPLE / "image.png").convert("RGB")).astype(int)
        ).max()
        > 10
    )


def test_ruler_and_diameter_give_kilometers_per_hour(solved):
    solved.get_by_role("tab", name="Measure").click()
    solved.get_by_label("Diameter").fill("4cm")
    solved.get_by_label("Exposure time").fill("1/60")
    solved.get_by_role("button", name="Measure", exact=True).click()
    by_diameter = solved.locator(".speed", has_text="km/h").inner_text()
    solved.get_by_label("Diameter").fill("")
    solved.get_by_role("button", name="Ruler", exact=True).click()
    for name, value in {
        "x0": 0.5,
        "y0": 0.5,
        "x1": 36.48,
        "y1": 0.5,
    }.items():  # 35.98 px: its diameter
        solved.get_by_label(f"Ruler {name}").fill(str(value))
        solved.get_by_label(f"Ruler {name}").press("Tab")
    solved.get_by_label("Length of the ruler").fill("4cm")
    solved.get_by_role("button", name="Measure", exact=True).click()
    expect(solved.get_by_role("group", name="Command")).to_contain_text(
        "--scale 0.0,0.0,36.0,0.0=4cm"
    )
    expect(solved.locator(".speed")).not_to_have_text(by_diameter)
    first, second = (
        float(text.split()[0]) for text in (by_diameter, solved.locator(".speed").inner_text())
    )
    assert first == pytest.approx(42.5, abs=0.2)
    assert second == pytest.approx(42.5, abs=0.2)


def test_a_reload_loses_nothing(solved):
    solved.get_by_role("tab", name="Edit").click()
    solved.get_by_role("slider", name="Fade").fill("0.7")
    solved.reload()
    solved.get_by_role("button", name="Write the changed picture").wait_for()
    assert solved.get_by_role("slider", name="Fade").input_value() == "0.7"
    solved.get_by_role("tab", name="Solve").click()
    assert solved.locator(".grade").inner_text().startswith("plausible")
    solved.get_by_label("View", exact=True).last.select_option("alpha")
    assert drawn(solved).max() == 255


def test_a_color_that_fits_is_solved_with(doubtful):
    assert re.match("plausible|assumed", doubtful.get_by_role("status").inner_text())
    colors = doubtful.get_by_role("radiogroup", name="Colors that fit").get_by_role("radio")
    assert colors.count() > 1
    label = doubtful.locator(".alternative").last.inner_text()
    assert "alpha ×" in label
    colors.last.check()
    command = doubtful.get_by_role("group", name="Command")
    expect(command).to_contain_text(re.compile("solve white.png .*--color '#[0-9a-f]{6}'"))
    expect(command).to_contain_text("done")
    assert doubtful.get_by_role("status").inner_text()


@pytest.mark.battery
def test_a_cancelled_job_leaves_nothing_and_a_reload_loses_no_job_that_runs(doubtful, server):
    command = doubtful.get_by_role("group", name="Command")
    before = helpers(server)
    doubtful.get_by_role("button", name="Solve", exact=True).click()
    doubtful.locator(".progress", has_text="solve").wait_for()
    doubtful.get_by_role("button", name="Cancel").click()
    expect(command).to_contain_text("cancelled")
    number = re.search(r"-o (\d+)", command.inner_text())[1]
    (files,) = server.folder.glob("blurmatte-*/files")
    wait_for(lambda: helpers(server) - before)
    assert len(before - helpers(server)) == 1  # the worker
    assert list((files / number).iterdir()) == []
    doubtful.get_by_role("button", name="Resume").click()
    doubtful.locator(".progress", has_text="solve").wait_for()
    doubtful.reload()
    doubtful.locator(".progress", has_text="solve").wait_for()
    expect(command).to_contain_text("done")
    doubtful.locator(".grade").wait_for()
    assert "layer.exr" in [path.name for path in (files / number).iterdir()]


@pytest.mark.battery
def test_a_clip_goes_from_dropping_to_the_table(browser, address, scene):
    page = opened(browser, address)
    page.get_by_label("Picture or clip").set_input_files(scene / "clip.mov")
    page.get_by_label("Plate", exact=True).set_input_files(scene / "clip_plate.png")
    page.get_by_role("button", name="Find its shots").click()
    page.get_by_text("one shot").wait_for()
    page.get_by_role("tab", name="Measure").click()
    page.get_by_role("button", name="Track", exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download track.csv").click()
    rows = list(csv.DictReader(Path(download.value.path()).read_text().splitlines()))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert [float(row["x"]) for row in rows] == pytest.approx([37, 49, 61, 73], abs=0.5)
    page.get_by_label("Frame", exact=True).fill("2")
    page.get_by_label("Frame", exact=True).press("Tab")
    expect(page.locator(".doubts")).to_contain_text("Frame 2: x 61")
    charts = page.get_by_role("img", name=re.compile("chart over frames"))
    names = [one.get_attribute("aria-label") for one in charts.all()]
    assert any("y, pixels: from" in name and "in 4 frames" in name for name in names)
    assert page.locator(".fall").inner_text().startswith("No free fall: ")
    assert (page.foreign, page.faults) == ([], [])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_violation_of_accessibility(browser, address, solved, scheme):
    axe = pytest.importorskip("axe_core_python.sync_playwright", reason="needs axe-core-python")
    solved.emulate_media(color_scheme=scheme)
    for tab in ("Solve", "Edit", "Measure", "Sharp"):
        solved.get_by_role("tab", name=tab).click()
        solved.get_by_role("tab", name=tab, selected=True).wait_for()
        rules = {} if scheme == "light" else {"runOnly": ["color-contrast"]}
        faults = axe.Axe().run(solved, options=rules)["violations"]
        assert [(one["id"], one["nodes"][0]["html"]) for one in faults] == []


def test_everything_is_reached_by_keyboard(browser, address):
    page = opened(browser, address)
    page.get_by_label("Picture or clip").set_input_files(EXAMPLE / "image.png")
    page.get_by_label("View", exact=True).last.wait_for()
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "document.activeElement.getAttribute('aria-label') ?? document.activeElement.innerText"
            )
        )
    assert {
        "Solve",
        "View",
        "Exposure",
        "Before and after",
        "Pan",
        "Box",
        "Pick color",
        "Ruler",
    } <= reached
    before = page.locator(".overlay g").get_attribute("transform")
    page.locator(".viewer").focus()
    page.keyboard.press("+")
    expect(page.locator(".overlay g")).not_to_have_attribute("transform", before)


def test_a_picture_that_cannot_be_read_is_asked_for_once(browser, address):
    page, asked = opened(browser, address), []
    page.on("request", lambda request: asked.append(request.url))
    cut = (EXAMPLE / "image.png").read_bytes()[:4000]
    page.get_by_label("Picture or clip").set_input_files(
        {"name": "broken.png", "mimeType": "image/png", "buffer": cut}
    )
    page.get_by_text("broken.png: copy or export it again").wait_for()
    page.wait_for_timeout(500)
    described = [url for url in asked if "/describe" in url]
    assert len(described) == len(set(described)) > 0


def test_a_reason_stays_while_the_page_reads_other_files(browser, address, solved):
    page = opened(browser, address)
    page.get_by_label("Picture or clip").set_input_files(
        {"name": "cut.png", "mimeType": "image/png", "buffer": b"\x89PNG\r\n\x1a\n"}
    )
    page.get_by_text("cut.png: ").first.wait_for()
    page.evaluate(
        """async () => {
          const { describe, store } = await import("/page/store.js");
          const other = store.server.files.find((one) => one.name === "image.png");
          store.facts.delete(`file=${other.number}`);
          await describe({ file: other.number });
        }"""
    )
    assert "cut.png: " in page.evaluate("import('/page/store.js').then((page) => page.store.error)")


def test_nothing_was_asked_of_other_hosts_and_no_script_failed(solved):
    assert solved.foreign == []
    assert solved.faults == []


PAGE = ROOT / "src" / "blurmatte" / "ui" / "page"


def test_the_page_is_small():
    assert sum(path.stat().st_size for path in PAGE.rglob("*") if path.is_file()) <= 250_000


def test_libraries_are_those_that_are_stated():
    stated = (PAGE / "vendor" / "SOURCES.txt").read_text().partition("SHA-256\n")[2]
    pairs = [line.split() for line in stated.splitlines()]
    assert {name for _, name in pairs} == {
        p.name for p in (PAGE / "vendor").iterdir() if p.suffix in (".js", ".css")
    }
    for digest, name in pairs:
        assert hashlib.sha256((PAGE / "vendor" / name).read_bytes()).hexdigest() == digest
