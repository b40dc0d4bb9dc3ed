"""The commands for scenes with a known answer: render and score."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import (
    ExitCode,
    about,
    answer,
    argument,
    complain,
    option,
    optional,
    output,
    say,
    say_json,
    switch,
    with_progress,
)
from blurmatte.cli.paths import check_file, check_folder, check_outputs, expanded, with_folders
from blurmatte.formats import NUMBERS


@command("render easy -o scenes/easy", "render --list", "render --archive -o scenes.zip")
def render(
    scenes: Annotated[
        list[str] | None, argument("SCENE", "Scene files (TOML), or names of --list.")
    ] = None,
    out: Annotated[Path | None, output("For the pictures and the truth.", "FOLDER")] = None,
    all_scenes: bool = switch("--all", "All scenes that come with blurmatte."),
    list_scenes: bool = switch("--list", "Print the names of the scenes that come with it."),
    archive: bool = switch("--archive", "Forty scenes for other programs, as one .zip."),
    max_pixels: int | None = optional("N", "Refuse larger scenes; 25 million."),
    as_json: AsJson = False,
) -> None:
    """Render a SCENE: pictures to solve, and their true alpha.

    Several scenes, and the frames of a clip, each get a folder of their own.
    """
    if list_scenes:
        titles = {name: bm.scenes.scene_title(name) for name in bm.scenes.scene_names()}
        answer(as_json, titles, [f"{name:12} {title}" for name, title in titles.items()])
        return
    if archive:
        if out is None or scenes or all_scenes:
            raise ValueError("give --archive with --out FILE.zip alone: its scenes are fixed")
        _write_archive(out, as_json)
        return
    names = [*(scenes or ()), *(bm.scenes.scene_names() if all_scenes else ())]
    if not names:
        raise ValueError("give a SCENE, or --all, or --list to see what there is")
    if out is None:
        raise ValueError("give --out, the folder for the pictures and the truth")
    from blurmatte.scenes.reading import MAX_RENDERED_PIXELS, scene_files
    from blurmatte.scenes.saving import SHOT_FILES

    check_folder(out)
    most = MAX_RENDERED_PIXELS if max_pixels is None else max_pixels
    shots = [
        (shot, bm.scenes.scene_text(name), folder)
        for name, place in with_folders(_scene_paths(names), out)
        for shot, folder in _numbered(bm.scenes.read_shots(name, most), place)
    ]
    read = [path for name in names for path in scene_files(name)]
    check_outputs(*(folder / name for *_, folder in shots for name in SHOT_FILES), inputs=read)
    for shot, text, folder in with_progress(shots, "rendering"):
        with about(folder):
            bm.scenes.save_shot(folder, shot, text)
        if not as_json:
            say(str(folder / "overview.png"))
    if as_json:
        say_json({"folders": [folder for _, _, folder in shots]})


def _write_archive(path: Path, as_json: bool) -> None:
    """Write the archive of scenes, and say what it is."""
    check_file(path, "an archive", ".zip")
    names = list(bm.scenes.archive_scenes())
    with about(path):
        for _ in with_progress(bm.scenes.save_archive(path), "rendering", len(names)):
            pass
    size = path.stat().st_size
    answer(
        as_json, {"archive": path, "scenes": names, "bytes": size}, [f"{path}: {size / 1e6:.0f} MB"]
    )


@command(
    "score results/easy/layer.exr --truth scenes/easy",
    "score results/ --truth scenes/ -o scores.json",
)
def score(
    result: Annotated[
        Path, argument("RESULT", "A layer file, a folder with one, or a folder of such folders.")
    ],
    truth: Annotated[Path, option("FOLDER", "What render wrote: a scene, or many.")],
    out: Annotated[Path | None, output("Write the scores: .json or .csv.")] = None,
    as_json: AsJson = False,
) -> None:
    """Score a RESULT of any program against the truth.

    A scene of several that has no result counts as a miss.
    """
    check_file(out, "a table of scores", *NUMBERS)
    places = bm.scenes.find_scenes(truth)
    read = [file for place in places for file in (place / "truth").iterdir()]
    read += [result / place.relative_to(truth) / "path.json" for place in places]
    check_outputs(out, inputs=read)
    scores, broken = {}, False
    for place in with_progress(places, "scoring"):
        name = str(place.relative_to(truth)) if place != truth else truth.name
        try:
            with about(result / name if place != truth else result):
                given = bm.scenes.read_answer(result / name if place != truth else result)
                scores[name] = bm.scenes.score(given, bm.scenes.read_truth(place))
        except bm.BlurmatteError as error:
            if place == truth:
                raise
            missing = not (result / name).exists()
            broken |= not missing
            complain(f"{name}: no result, a miss" if missing else f"{error}; a miss")
            scores[name] = bm.scenes.score(None, bm.scenes.read_truth(place))
    answer(as_json, scores, [bm.scenes.score_table(scores)])
    if out is not None:
        rows = [{"scene": name, **vars(score)} for name, score in scores.items()]
        bm.write(out, rows if out.suffix.lower() == ".csv" else scores)
    if broken:
        raise typer.Exit(ExitCode.REFUSED)


def _scene_paths(names: list[str]) -> list[Path]:
    """The scene files; names of the built-in scenes stay as they are."""
    own = set(bm.scenes.scene_names())
    return [path for name in names for path in ([Path(name)] if name in own else expanded([name]))]


def _numbered(shots: list[bm.rendering.Shot], folder: Path) -> list[tuple[bm.rendering.Shot, Path]]:
    """Each shot and its folder: `folder` for a single one, otherwise one folder per frame."""
    if len(shots) == 1:
        return [(shots[0], folder)]
    return [(shot, folder / f"{n:03}") for n, shot in enumerate(shots)]
