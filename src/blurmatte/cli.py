"""The command line: one function for each command, a thin skin over the public API.

Answers go to stdout, everything else to stderr. What goes wrong is one line and exit code 2; an
answer that rests on an assumption comes with one line of warning.
"""

import functools
import re
import shlex
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from glob import glob
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

import numpy as np
import typer
from typer.core import TyperGroup

import blurmatte as bm

_TOLD = 5  # other things that moved

P = ParamSpec("P")
T = TypeVar("T")


class _Program(TyperGroup):
    """Tells what is wrong with the options in one line, like everything else."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        with _usage_in_one_line():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        with _usage_in_one_line():
            return super().invoke(ctx)


@contextmanager
def _usage_in_one_line() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        message = error.format_message().strip() if hasattr(error, "format_message") else "\n"
        if "\n" not in message:  # else it is the help, or nothing about usage
            where = getattr(getattr(error, "ctx", None), "command_path", "blurmatte")
            line = f"{message.rstrip('.')}; see {where} --help"
            error.show = lambda file=None: _complain(line)  # type: ignore[attr-defined]
        raise


app = typer.Typer(
    cls=_Program,
    help="Alpha and color of motion-blurred objects over a known background.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,  # rich takes longer to import than everything else
    pretty_exceptions_enable=False,
)

Image = Annotated[Path, typer.Argument(metavar="IMAGE", help="The picture with the streak.")]
Images = Annotated[
    list[str], typer.Argument(metavar="IMAGE", help="Pictures with a streak; quoted globs work.")
]
Plate = Annotated[Path, typer.Option(help="The same scene without the object.")]
Colors = Annotated[
    list[str] | None,
    typer.Option(
        "--color",
        metavar="HEX|X,Y[,RADIUS]|FILE.json|core",
        help="The object's color: sRGB-coded like #d8ff3c, pixels that show nothing else, a model "
        "that was written before, or the streak's opaque core. Repeat for more samples or a "
        "second color. Without it, the streak itself must tell.",
    ),
]
ColorFrom = Annotated[
    Path | None, typer.Option(help="A sharp picture of the object in which X,Y are picked.")
]
Rank = Annotated[int, typer.Option(help="1: shades of one color. 2: two, or highlights. 3: any.")]
Region = Annotated[
    str | None,
    typer.Option(metavar="X0,Y0,X1,Y1", help="Where the object moved; X1 and Y1 are excluded."),
]
Mask = Annotated[Path | None, typer.Option(help="A picture that is white where the object moved.")]
TransferName = Annotated[
    str | None,
    typer.Option(
        metavar="srgb|rec709|linear|gamma2.2|auto",
        help="How code values encode light, if you know better than the files; auto, of solve and "
        "color: what explains the streak.",
    ),
]
MaxBrightness = Annotated[
    float | None,
    typer.Option(help="How bright the object can be at most, linear, 1 = white; helps find it."),
]
SolverName = Annotated[
    str,
    typer.Option(
        metavar="auto|swept|smooth|pixelwise",
        help="swept: a shape on a path; smooth: all pixels together; pixelwise: each alone. auto: "
        "swept where a shape explains the streak, else smooth.",
    ),
]
Smoothness = Annotated[
    float | None,
    typer.Option(help="With smooth: times as smooth as the data ask for; 1 if not given."),
]
MaxPixels = Annotated[int, typer.Option(help="Larger pictures are refused.")]


def _told(command: Callable[P, T]) -> Callable[P, T]:
    """End with one line and exit code 2 instead of a traceback; quietly if interrupted."""

    @functools.wraps(command)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except (bm.BlurmatteError, ValueError, TypeError) as error:
            _complain(str(error))
            raise typer.Exit(2) from None

    return told


def _print_version(wanted: bool) -> None:
    if wanted:
        _print(f"blurmatte {bm.__version__}")
        raise typer.Exit


@app.callback()
def _blurmatte(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", is_eager=True, callback=_print_version
        ),
    ] = False,
) -> None:
    pass


@app.command()
@_told
def solve(
    images: Images,
    plate: Plate,
    out: Annotated[Path, typer.Option(help="Folder for the results, made if it is not there.")],
    color: Colors = None,
    color_from: ColorFrom = None,
    rank: Rank = 1,
    region: Region = None,
    mask: Mask = None,
    transfer: TransferName = None,
    max_brightness: MaxBrightness = None,
    solver: SolverName = "auto",
    smoothness: Smoothness = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Separate the moving object in each IMAGE from its background.

    Writes alpha.png, color.png, layer.exr, layer.png, model.json, overview.png and report.json into
    the folder; for several images, each into a folder of its own in there.
    """
    way = _solver(solver, smoothness)
    files = _settled(_Files(transfer, max_pixels), _places(images, out)[0][0], plate)
    B, notes = files.read(plate)
    task = _Task(B, files, tuple(color or ()), color_from, rank, region, mask, max_brightness)
    failed = 0
    for path, folder in _with_progress(_places(images, out)):
        try:
            with _about(path) as said:
                C, _ = files.read(path, said)
                streak = task.streak(C)
                solution = bm.solve(C, B, task.model(C, streak), way, streak=streak)
                said += _doubted(path, solution)
                said += _curve_doubted(path, C, B, solution, files)
                called = shlex.join(["blurmatte", *sys.argv[1:]])
                bm.save_results(folder, C, B, solution, called, notes + said)
        except bm.BlurmatteError as error:
            _complain(str(error))
            failed += 1
        else:
            _print("\n".join([str(solution), _in_degrees(solution.model), *_others(solution)]))
            _print(str(folder / "overview.png"))
    if failed:
        raise typer.Exit(2)


@app.command()
@_told
def color(
    image: Image,
    plate: Plate,
    out: Annotated[Path | None, typer.Option(help="Where to write the model: a .json.")] = None,
    color: Colors = None,
    color_from: ColorFrom = None,
    rank: Rank = 1,
    region: Region = None,
    mask: Mask = None,
    transfer: TransferName = None,
    max_brightness: MaxBrightness = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Find the color of the moving object, and say how sure that is."""
    files = _settled(_Files(transfer, max_pixels), image, plate)
    B, _ = files.read(plate)
    task = _Task(B, files, tuple(color or ()), color_from, rank, region, mask, max_brightness)
    with _about(image) as said:
        C, _ = files.read(image, said)
        streak = task.streak(C)
        model = task.model(C, streak) or bm.fit_color(C, B, streak)
        if out is not None:
            bm.write(out, model)
    _print("\n".join([_in_degrees(model), *_swatches(model), *bm.explain(model)]))


@app.command()
@_told
def compose(
    layer: Annotated[
        Path, typer.Argument(metavar="LAYER", help="A layer with alpha: EXR, PNG, TIFF.")
    ],
    over: Annotated[Path, typer.Option(help="The picture to put it over.")],
    out: Annotated[Path, typer.Option(help="Where to write: .png, .tif, .jpg or .exr.")],
    fit: Annotated[
        str | None,
        typer.Option(metavar="cover", help="Scale the picture to the layer's size and crop it."),
    ] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Put LAYER over another picture, in linear light."""
    if fit not in (None, "cover"):
        raise ValueError(f"--fit {fit}: there is only one fit, cover")
    files = _Files(transfer, max_pixels)
    with _about(layer):
        top = bm.read_layer(layer, files.curve, max_pixels)
    picture, _ = files.read(over)
    with _about(over):
        if fit == "cover":
            picture = bm.cover(picture, top.size)
        if picture.size != top.size:
            raise ValueError(
                f"the picture is {_by(picture.size)} pixels and the layer {_by(top.size)}; "
                "add --fit cover to scale and crop the picture"
            )
    with _about(out):
        bm.write(out, top.over(picture))


@app.command()
@_told
def render(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="SCENE", help="Scene files (TOML), or names that --list tells."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures and the truth.")] = None,
    all_scenes: Annotated[
        bool, typer.Option("--all", help="All scenes that come with blurmatte.")
    ] = False,
    list_scenes: Annotated[
        bool, typer.Option("--list", help="Print the names of the scenes that come with it.")
    ] = False,
) -> None:
    """Render a scene whose alpha, color and path are known: pictures to solve, and the truth.

    Several scenes, and the frames of a clip, each get a folder of their own.
    """
    if list_scenes:
        _print("\n".join(f"{name:12} {bm.scene_title(name)}" for name in bm.scene_names()))
        return
    names = [*(scenes or ()), *(bm.scene_names() if all_scenes else ())]
    if not names:
        raise ValueError("give a SCENE, or --all, or --list to see what there is")
    if out is None:
        raise ValueError("--out is missing: the folder for the pictures and the truth")
    shots = [
        (shot, bm.scene_text(name), folder)
        for name, place in _places(names, out)
        for shot, folder in _numbered(bm.read_shots(name), place)
    ]
    for shot, text, folder in _with_progress(shots, "rendering"):
        with _about(folder):
            bm.save_shot(folder, shot, text)
        _print(str(folder / "overview.png"))


@app.command()
@_told
def score(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT", help="A layer file, a folder with one, or a folder of such folders."
        ),
    ],
    truth: Annotated[Path, typer.Option(help="What blurmatte render wrote: a scene, or many.")],
    out: Annotated[Path | None, typer.Option(help="Write the scores to a .json, too.")] = None,
) -> None:
    """Say how far a RESULT of any program is from the truth.

    A scene of several that has no result counts as a miss.
    """
    places = bm.find_scenes(truth)
    scores, broken = {}, False
    for place in _with_progress(places, "scoring"):
        name = str(place.relative_to(truth)) if place != truth else truth.name
        try:
            with _about(result / name if place != truth else result):
                answer = bm.read_answer(result / name if place != truth else result)
                scores[name] = bm.score(answer, bm.read_truth(place))
        except bm.BlurmatteError as error:
            if place == truth:
                raise
            missing = not (result / name).exists()
            broken |= not missing
            _complain(f"{name}: no result, a miss" if missing else f"{error}; a miss")
            scores[name] = bm.score(None, bm.read_truth(place))
    _print(bm.score_table(scores))
    if out is not None:
        bm.write(out, {name: asdict(score) for name, score in scores.items()})
    if broken:
        raise typer.Exit(2)


@app.command()
@_told
def info(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A picture, a layer, a solution or a model.")
    ],
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Say what is in FILE."""
    files = _Files(transfer, max_pixels)
    with _about(file) as said:
        if file.suffix.lower() == ".json":
            model = bm.read_color_model(file)
            lines = [_in_degrees(model), *bm.explain(model)]
        elif (solution := _solution(file, max_pixels)) is not None:
            facts = (f"{name}: {value}" for name, value in solution.stats.items())
            lines = [str(solution), f"solver: {solution.solver}"]
            lines += [_in_degrees(solution.model), *bm.explain(solution), *facts]
        else:
            picture, _ = files.read(file, said)
            layer = _layer(file, files.curve, max_pixels)
            lines = list(_facts(file, picture, layer, transfer, guessed=bool(said)))
    _print("\n".join(lines))


@dataclass(frozen=True)
class _Files:
    """How picture files are read."""

    transfer: str | None
    max_pixels: int

    @property
    def curve(self) -> bm.Transfer | None:
        return None if self.transfer is None else bm.named_transfer(self.transfer)

    def read(self, path: Path, said: list[str] | None = None) -> tuple[bm.LinearImage, list[str]]:
        """The picture, and what there was to warn of (also added to `said`)."""
        with _about(path) as notes:
            picture = bm.read(path, self.curve, self.max_pixels)
        if said is not None:
            said += notes
        return picture, notes


def _settled(files: _Files, image: Path, plate: Path) -> _Files:
    """With the curve that the streak allows, if that is asked for."""
    if files.transfer != "auto":
        return files
    files = replace(files, transfer=None)
    with _about(image):
        fit = bm.fit_transfer(files.read(image)[0], files.read(plate)[0])
    also = ", ".join(curve.name for curve in fit.possible if curve is not fit.best)
    _print(f"transfer: {fit.best.name}" + (f"; as possible: {also}" if also else ""))
    return files if fit.best is fit.curves[0] else replace(files, transfer=fit.best.name)


def _solver(name: str, smoothness: float | None) -> bm.Pixelwise | bm.Smooth | bm.Swept | None:
    """The solver of a name; None: what suits."""
    if smoothness is not None and name != "smooth":
        raise ValueError(f"--smoothness is for --solver smooth, the solver is {name}")
    match name:
        case "auto":
            return None
        case "swept":
            return bm.Swept()
        case "smooth":
            return bm.Smooth() if smoothness is None else bm.Smooth(smoothness)
        case "pixelwise":
            return bm.Pixelwise()
    raise ValueError(f"--solver must be auto, swept, smooth or pixelwise, got {name!r}")


@dataclass(frozen=True)
class _Task:
    """What the options of `solve` and `color` ask for."""

    plate: bm.LinearImage
    files: _Files
    colors: tuple[str, ...]
    color_from: Path | None
    rank: int
    region: str | None
    mask: Path | None
    max_brightness: float | None

    def streak(self, image: bm.LinearImage) -> bm.Streak | None:
        """Where to look; None: wherever something moved."""
        if self.region is not None and self.mask is not None:
            raise ValueError("give --region or --mask, not both")
        if self.region is not None:
            x0, y0, x1, y1 = (int(n) for n in _numbers("--region", self.region, 4))
            region = bm.Streak.from_box((x0, y0, x1, y1), image.size)
            return bm.find_streak_within(region, image, self.plate)
        if self.mask is None:
            return None
        mask = bm.read(self.mask, bm.LINEAR, self.files.max_pixels)
        if mask.size != image.size:
            raise ValueError(
                f"the mask {self.mask} is {_by(mask.size)} pixels, the image {_by(image.size)}"
            )
        return bm.Streak(np.asarray(mask.rgb.max(axis=-1) > 0.5))

    def model(self, image: bm.LinearImage, streak: bm.Streak | None) -> bm.ColorModel | None:
        """The model that the colors make; None: the streak itself must tell."""
        if self.rank not in (1, 2, 3):
            raise ValueError(f"--rank must be 1, 2 or 3, got {self.rank}")
        kinds = {_kind(color) for color in self.colors}
        if self.color_from is not None and "point" not in kinds:
            raise ValueError("--color-from needs points to pick: add --color X,Y")
        if not kinds:
            return self._fitted(image, streak)
        if self.rank == 3:
            raise ValueError("--rank 3 is for objects of any colors: leave --color out")
        if len(kinds & {"hex", "file"}) and len(kinds) > 1:
            raise ValueError("give hex colors, or a model file, or points and core: not a mixture")
        if kinds == {"file"}:
            return self._from_file()
        if kinds == {"hex"}:
            if len(self.colors) != self.rank:
                raise ValueError(
                    f"--rank {self.rank} takes {self.rank} hex color{'s' * (self.rank - 1)}, got "
                    f"{len(self.colors)}: one color is --rank 1, two colors are --rank 2"
                )
            return bm.ColorModel.from_hex(*self.colors)
        samples = np.concatenate([self._samples(c, image, streak) for c in self.colors])
        return bm.ColorModel.from_samples(samples, self.rank, robust="core" in kinds)

    def _fitted(self, image: bm.LinearImage, streak: bm.Streak | None) -> bm.ColorModel | None:
        if self.rank == 3:
            return bm.ColorModel.any()
        if self.rank != 1:
            raise ValueError("--rank 2 needs colors: give two with --color, hex or points")
        if self.max_brightness is None:
            return None
        return bm.fit_color(image, self.plate, streak, self.max_brightness)

    def _from_file(self) -> bm.ColorModel:
        if len(self.colors) > 1:
            raise ValueError("give one model file, not several")
        return bm.read_color_model(self.colors[0])

    def _samples(self, color: str, image: bm.LinearImage, streak: bm.Streak | None) -> Any:
        if color == "core":
            return bm.core_colors(image, self.plate, streak)
        x, y, *radius = _numbers("--color", color, 2, 3)
        if self.color_from is None:
            return bm.pick_colors(image, x, y, *radius)
        return bm.pick_colors(self.files.read(self.color_from)[0], x, y, *radius)


def _kind(color: str) -> str:
    if color == "core":
        return "core"
    if color.lower().endswith(".json"):
        return "file"
    return "point" if "," in color else "hex"


def _numbers(name: str, text: str, *counts: int) -> list[float]:
    """Numbers with commas between them, as many as one of `counts`."""
    parts = text.split(",")
    whole = r"\s*-?\d+\s*" if 4 in counts else r"\s*-?\d+(\.\d*)?\s*"
    if len(parts) not in counts or not all(re.fullmatch(whole, part) for part in parts):
        what = "x0,y0,x1,y1 in whole pixels" if 4 in counts else "x,y or x,y,radius"
        raise ValueError(f"{name} must be {what}, got {text!r}")
    return [float(part) for part in parts]


def _places(images: Iterable[str], out: Path) -> list[tuple[Path, Path]]:
    """Each image and the folder for its results: `out` itself if there is but one."""
    paths = [path for text in images for path in _expanded(text)]
    if len(paths) == 1:
        return [(paths[0], out)]
    stems = [path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise ValueError(f"{stems.count(stem)} images are called {stem}; solve them apart")
    return [(path, out / path.stem) for path in paths]


def _expanded(text: str) -> list[Path]:
    if Path(text).exists() or not re.search(r"[*?\[]", text):
        return [Path(text)]
    found = sorted(glob(text, recursive=True))
    if not found:
        raise bm.FileError(f"{text}: there are no such files; check the pattern")
    return [Path(path) for path in found]


def _numbered(shots: list[bm.Shot], folder: Path) -> list[tuple[bm.Shot, Path]]:
    """Each shot and its folder: `folder` itself if there is but one, else frames by number."""
    if len(shots) == 1:
        return [(shots[0], folder)]
    return [(shot, folder / f"{n:03}") for n, shot in enumerate(shots)]


def _with_progress(things: list[T], doing: str = "solving") -> Iterator[T]:
    """A bar on stderr for several things, if a person is watching."""
    if len(things) < 2 or not sys.stderr.isatty():
        yield from things
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), redirect_stdout=False) as progress:
        yield from progress.track(things, description=doing)


class _NamedError(bm.BlurmatteError):
    """Its message begins with the name of the file, as that of every FileError does."""


@contextmanager
def _about(path: Path) -> Iterator[list[str]]:
    """Name the file in whatever goes wrong with it; the list grows by what is warned of."""
    said: list[str] = []
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
            if not issubclass(category, bm.BlurmatteWarning):
                usual(message, category, *place)
                return
            named = issubclass(category, bm.TransferWarning)
            line = str(message) if named else f"{path}: {message}"
            if line not in said:
                said.append(line)
                _complain(f"warning: {line}")

        warnings.simplefilter("always", bm.BlurmatteWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        try:
            yield said
        except (bm.FileError, _NamedError):
            raise
        except MemoryError as error:
            raise _NamedError(f"{path}: too large for the memory; reduce it") from error
        except (bm.BlurmatteError, ValueError, TypeError, OSError) as error:
            raise _NamedError(f"{path}: {error}") from error


def _doubted(path: Path, solution: bm.Solution) -> list[str]:
    """Warn of what cannot be true in a solution; returns the warnings."""
    from blurmatte.explain import doubts

    lines = [f"{path}: {doubt.rstrip('.')}" for doubt in doubts(solution)]
    for line in lines:
        _complain(f"warning: {line}")
    return lines


def _curve_doubted(
    path: Path, image: bm.LinearImage, plate: bm.LinearImage, solution: bm.Solution, files: _Files
) -> list[str]:
    """Warn if another curve lets a disc of one color explain what is not one now."""
    disc = solution.stats.get("sweep", {}).get("silhouette") == "disc" and solution.model.rank == 1
    curves = image.meta.transfer, plate.meta.transfer
    alike = None not in curves and len({curve.name for curve in curves if curve}) == 1
    if disc or files.transfer is not None or not alike:
        return []
    fit = bm.fit_transfer(image, plate, bm.Streak(solution.streak))
    if fit.best is fit.curves[0]:
        return []
    line = (
        f"{path}: light looks bent: with --transfer {fit.best.name} a disc of one color explains "
        f"the streak, with {fit.curves[0].name} none does"
    )
    _complain(f"warning: {line}")
    return [line]


def _others(solution: bm.Solution) -> Iterator[str]:
    """What else moved, as regions to copy."""
    boxes = [",".join(map(str, box)) for box in solution.stats.get("other_boxes", ())]
    if boxes:
        more = f" and {len(boxes) - _TOLD} more" if len(boxes) > _TOLD else ""
        yield f"also moved, choose with --region: {' '.join(boxes[:_TOLD])}{more}"


def _solution(path: Path, max_pixels: int) -> bm.Solution | None:
    """The Solution in an EXR, if it is one."""
    if path.suffix.lower() != ".exr":
        return None
    try:
        return bm.read_solution(path, max_pixels)
    except bm.FileError:  # whatever is wrong, reading it as a picture will tell
        return None


def _layer(path: Path, curve: bm.Transfer | None, max_pixels: int) -> bm.Layer | None:
    """The layer in a picture file, if it has an alpha that is not 1 everywhere."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bm.TransferWarning)  # reading the picture told it
            layer = bm.read_layer(path, curve, max_pixels)
    except bm.FileError:
        return None
    return layer if layer.alpha.min() < 1 else None


def _facts(
    path: Path,
    picture: bm.LinearImage,
    layer: bm.Layer | None,
    transfer: str | None,
    guessed: bool,
) -> Iterator[str]:
    from blurmatte.files.raster import load
    from blurmatte.files.refusals import kind_of

    meta = picture.meta
    bits = "float" if meta.levels is None else f"{int(np.log2(meta.levels))} bit"
    colors = "gray" if meta.gray else "RGB"
    what = ""
    if layer is not None:
        way = "premultiplied" if load(path, max(1, layer.alpha.size)).associated else "straight"
        what = f" and {way} alpha: a layer"
    yield f"{path}: {kind_of(path)}, {_by(picture.size)} pixels, {bits} {colors}{what}"
    source = "as you said" if transfer else "a guess: nothing in the file says"
    if not (transfer or guessed):
        source = "its ICC profile says" if meta.icc_profile else "its tags or its kind say"
    yield f"transfer: {meta.transfer.name if meta.transfer else 'linear'} ({source})"
    time = f"{meta.exposure_time:.6g} s" if meta.exposure_time else "not told"
    yield f"exposure time: {time}"
    profile = f"{len(meta.icc_profile)} bytes" if meta.icc_profile else "none"
    yield f"ICC profile: {profile}"
    if layer is None:
        yield f"valid (not clipped, opaque): {np.mean(picture.valid):.2%}"
        yield f"light: {picture.rgb.min():.4g} to {picture.rgb.max():.4g}, 1 is white"
        return
    alpha, light = layer.alpha, layer.premultiplied
    yield (
        f"alpha: up to {alpha.max():.4g}, above 0 in {np.mean(alpha > 0):.2%} of the pixels, "
        f"sum {alpha.sum(dtype=float):.6g}"
    )
    yield f"light times alpha: {light.min():.4g} to {light.max():.4g}, 1 is white"


def _swatches(model: bm.ColorModel) -> list[str]:
    """The colors still possible as blocks of color, the likeliest first, where they can be shown."""
    if model.rank == 3 or not sys.stdout.isatty():
        return []
    blocks = [[_block(*bytes.fromhex(color[1:])) for color in m.hex] for m in model.possible]
    return [" ".join(row) for row in zip(*blocks, strict=True)]


def _block(red: int, green: int, blue: int) -> str:
    return typer.style("    ", bg=(red, green, blue))


def _in_degrees(model: bm.ColorModel) -> str:
    if model.rank == 3:
        return "any colors  rank 3"
    sure = f"± {model.angle_std:.2g}°" if model.evidence else "given"
    return f"{' + '.join(model.hex)}  rank {model.rank}, {sure}"


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _print(text: str) -> None:
    """To stdout, whatever bytes the names of files hold."""
    typer.echo(text.encode("utf-8", "backslashreplace").decode())


def _complain(text: str) -> None:
    """One line to stderr."""
    typer.echo(f"blurmatte: {' '.join(text.split())}", err=True)
