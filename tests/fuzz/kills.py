"""Kill commands at every file event, and check what they leave; run by test_kills.

A server imports everything once, but reads no picture, which would start threads; each run is a process
that it forks. `python -m tests.fuzz.kills FOLDER EVERY
NAME…` prints JSON: how many runs were killed, and what was wrong.
"""

import io
import json
import os
import pkgutil
import shutil
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
from tests.scenes.texts import BALL
from typer.testing import CliRunner

import blurmatte
import blurmatte as bm
from blurmatte.cli import app
from blurmatte.files import raster_writing
from blurmatte.rendering import Ball, Scene, colorful_plate

KILLED = 99
EVENTS = "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod"
PIXELWISE = "--solver", "pixelwise", "--transfer", "srgb"
NO_TEXT = os.fsdecode(b"f\xff.png")  # a name that is not UTF-8

Files = dict[str, bytes]


def make_inputs(folder: Path) -> None:
    """Pictures, layers, frames and a scene, all small."""
    folder.mkdir()
    size = 64, 48
    plate = colorful_plate(size, 2, tile=12)
    for k in range(4):
        path = bm.Trajectory.line((12 + 6 * k, 14), (22 + 6 * k, 18 + 3 * k))
        truth = bm.rendering.render(Scene(plate, path, Ball(6)))
        image, empty = bm.rendering.Shot(
            truth.scene, bm.rendering.Camera(code_std=1 / 255)
        ).photograph(truth)
        bm.write(folder / f"f{k}.png", image)
        bm.write(folder / f"l.{k + 1:04}.exr", truth.layer)
        bm.write(folder / f"b{k}.png", bm.LinearImage((empty.rgb * 0.5**k).astype(np.float32)))
    bm.write(folder / "plate.png", empty)
    bm.write(folder / "f3.jpg", image)
    shutil.copy(folder / "f1.png", folder / NO_TEXT)
    bm.write(folder / "layer.exr", bm.solve(image, empty, truth.model, bm.Pixelwise()))
    (folder / "scene.toml").write_text(BALL)
    (folder / "old.toml").write_text(BALL.replace("radius = 5", "radius = 4"))
    bm.scenes.save_shot(folder / "truth", bm.scenes.read_shots(folder / "scene.toml")[0])


def warm() -> None:
    """Import everything, and load compiled kernels, so that forked processes need not."""
    for module in pkgutil.walk_packages(blurmatte.__path__, "blurmatte."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    path = bm.Trajectory.line((12, 14), (30, 20))
    shot = bm.rendering.Shot(
        Scene(colorful_plate((64, 48), 2, tile=12), path, Ball(6)), bm.rendering.Camera(bits=8)
    )
    truth = bm.rendering.render(shot.scene)
    image, plate = shot.photograph(truth)
    solution = bm.solve(image, plate, truth.model, bm.Pixelwise())
    bm.figures.draw_overview(image, plate, solution)
    bm.make_plate([image, plate, image, plate])
    list(bm.motion.sightings([image], plate, truth.model))
    bm.explain(solution)
    CliRunner().invoke(app, ["info", "nowhere.json"])


def commands(i: Path, o: Path) -> dict[str, Callable[[bool], list[str | Path]]]:
    """Each command; its argument is whether the older files are made, with other options."""
    image, plate, layer = i / "f3.png", i / "plate.png", i / "layer.exr"
    pair = image, "--plate", plate

    def color(old: bool) -> str:
        return "#ff9040" if old else "#ffbc43"

    def fade(old: bool) -> tuple[str, str]:
        return "--fade", "0.25" if old else "0.5"

    over = "--over", plate
    own = "--image", image, "--plate", plate
    return {
        "solve": lambda old: ["solve", *pair, *PIXELWISE, "--color", color(old), "-o", o / "s"],
        "pictures": lambda old: ["solve", i / "f0.png", i / NO_TEXT, "--plate", plate, *PIXELWISE,
                                 "--color", color(old), "--workers", "1", "-o", o / "s"],
        "plate": lambda old: ["plate", i / "f[0-3].png", *(["--frames", "0:3"] if old else []),
                              "-o", o / "p.exr"],
        "row": lambda old: ["edit", i / "l.####.exr", *fade(old), "-o", o / "r.####.exr"],
        "render": lambda old: ["render", i / ("old.toml" if old else "scene.toml"), "-o", o / "s"],
        "paints": lambda old: ["paints", layer, "--color", "#dca059", "--color",
                               "#2030ff" if old else "#3020ff", "-o", o / "p"],
        "track": lambda old: ["track", i / "f[0-3].png", "--plate", plate, "--color", color(old),
                              "--workers", "1", "-o", o / "t.csv", "--overlay", o / "t.png"],
        "edit": lambda old: ["edit", layer, *own, *fade(old), "-o", o / "e.png", "--sheet",
                             o / "sheet.png", "--preview", o / "p.gif"],
        "edit_jpeg": lambda old: ["edit", layer, "--image", i / "f3.jpg", "--plate", plate,
                                  *fade(old), "-o", o / "e.jpg"],
        "edit_tiff": lambda old: ["edit", layer, *own, *fade(old), "-o", o / "e.tif"],
        "clip": lambda old: ["edit", i / "l.####.exr", *fade(old), "-o", o / "r.mov"],
        "remove": lambda old: ["remove", layer, *own, "--grow", "3" if old else "1", "-o",
                               o / "e.png"],
        "compose": lambda old: ["compose", layer, *over, *fade(old), "-o", o / "e.exr", "--sheet",
                                o / "s.png"],
        "stack": lambda old: ["stack", i / "l.*.exr", *(["--long"] if old else []), "-o", o / "s.exr"],
        "show": lambda old: ["show", i / "f1.png" if old else layer, "-o", o / "s.png"],
        "color": lambda old: ["color", *pair, "--color", color(old), "-o", o / "c.json"],
        "noise": lambda old: ["calibrate", "noise", i / "b0.png", "--region",
                              "0,0,64,48" if old else "0,0,60,40", "-o", o / "n.json",
                              "--plot", o / "n.png"],
        "response": lambda old: ["calibrate", "response", *sorted(i.glob("b?.png"))[old:],
                                 "--exposures", "1,1/2,1/4" if old else "2,1,1/2,1/4", "-o",
                                 o / "r.json"],
        "score": lambda old: ["score", i / "truth/truth" / ("subframe_00.exr" if old else "layer.exr"),
                              "--truth", i / "truth", "-o", o / "s.csv"],
    }  # fmt: skip


JOURNALS = ".unfinished", "manifest.jsonl"  # grow line by line
SETS = "solve", "plate", "row", "render", "paints"  # files that belong together


def contents(folder: Path) -> Files:
    """All files of a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def restored(folder: Path, files: Files) -> None:
    """Let the folder hold these files alone."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def run(words: list[str | Path], folder: Path, stop: int = 0) -> tuple[int, int]:
    """Run a command in a process of its own, killed at a file event; exit code and events."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1), os.dup2(nowhere, 2)
        events = watch(folder, stop)
        code = 1
        try:
            sys.argv = ["blurmatte", *map(str, words)]
            app(sys.argv[1:])
        except SystemExit as ended:
            code = int(ended.code or 0)
        finally:
            os.write(writer, str(len(events)).encode())
            os._exit(code)
    os.close(writer)
    _, status = os.waitpid(child, 0)
    with open(reader, "rb") as pipe:
        return os.waitstatus_to_exitcode(status), int(pipe.read() or stop)


def watch(folder: Path, stop: int) -> list[str]:
    """Count the file events in a folder, and end this process before one of them."""
    events: list[str] = []

    def happens(name: str, path: object) -> None:
        if isinstance(path, str | Path) and str(path).startswith(str(folder)):
            events.append(name)
            if len(events) == stop:
                os._exit(KILLED)

    def audit(name: str, args: tuple[object, ...]) -> None:
        if name in EVENTS or (
            name == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR)
        ):
            happens(name, args[0])

    real_open, real_strips = io.open, raster_writing._write_strips

    def opened(path, mode="r", *more, **options):  # type: ignore[no-untyped-def]
        file = real_open(path, mode, *more, **options)
        if set(mode) & set("wax+"):
            happens("opened", path)  # it is empty now
        return file

    def half_written(*args):  # type: ignore[no-untyped-def]
        happens("half written", folder)
        return real_strips(*args)

    io.open, raster_writing._write_strips = opened, half_written
    sys.addaudithook(audit)
    return events


def faults(name: str, old: Files, new: Files, now: Files) -> Iterator[str]:
    """What is wrong with the files that a killed run left."""
    marked = {Path(file).name for file in now if file.endswith(".incomplete")}
    files = {
        file: content
        for file, content in now.items()
        if ".blurmatte-" not in file and not file.endswith((".incomplete", *JOURNALS))
    }
    for file, content in files.items():
        if content not in (old.get(file), new.get(file)):
            yield f"{file} is torn"
    for file in old.keys() - now.keys():
        if f"{Path(file).name}.incomplete" not in marked:
            yield f"{file} is lost"
    changed = {file for file in new if old.get(file) != new[file]}
    fresh = {file for file in changed if files.get(file) == new[file]}
    if name in SETS and not marked and fresh and fresh != changed:
        yield "old and new are mixed"


def killed(name: str, folder: Path, every: int, replaced: bool) -> tuple[int, list[str]]:
    """Kill one command at its file events; how often, and what was wrong."""
    inputs, out = folder / "in", folder / "out"
    words = commands(inputs, out)[name]
    before, old = contents(inputs), Files()
    restored(out, {})
    if replaced:
        if run(words(True), out)[0]:
            return 0, [f"{name}: the older run fails"]
        old = contents(out)
    code, count = run(words(False), out)
    new, wrong = contents(out), list[str]()
    if code or old == new:
        return 0, [f"{name}: fails with {code}, or changes nothing"]
    stops = range(1, count + 1, every)
    for stop in stops:
        restored(out, old)
        code, _ = run(words(False), out, stop)
        found = list(faults(name, old, new, contents(out)))
        again = words(False)
        if code != KILLED or run(again, out)[0]:
            found.append("the run was not killed, or fails afterwards")
        if contents(out) != new:
            found.append("a rerun gives other files")
        if contents(inputs) != before:
            found.append("an input was changed")
        wrong += [f"{name}, event {stop} of {count}, replacing {replaced}: {one}" for one in found]
    return len(stops), wrong


def main(folder: Path, every: int, names: list[str]) -> None:
    """Kill the named commands, or all."""
    warm()
    child = os.fork()
    if child == 0:
        try:
            make_inputs(folder / "in")
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    count, wrong = 0, list[str]()
    for name in names or commands(folder, folder):
        for replaced in (False, True):
            more, found = killed(name, folder, every, replaced)
            count, wrong = count + more, wrong + found
    print(json.dumps({"kills": count, "wrong": wrong}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
