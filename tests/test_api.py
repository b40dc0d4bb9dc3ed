"""The public API: its names are fixed, each is documented, and importing it is fast."""

import inspect
import re
import subprocess
import sys
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import blurmatte as bm

LIST = (Path(__file__).parent / "public_names.txt").read_text().split()
PUBLIC = {name: attrgetter(name)(bm) for name in LIST}
MOST_AT_THE_TOP = 44  # names; further ones are in the packages


def test_public_names_are_those_decided():
    top = {name for name in dir(bm) if not name.startswith("_")}
    packages = {name for name in top if inspect.ismodule(getattr(bm, name))}
    assert packages == {name.partition(".")[0] for name in LIST if "." in name}
    assert sorted(top - packages) == [name for name in LIST if "." not in name]
    assert len(top - packages) <= MOST_AT_THE_TOP


def test_public_names_are_listed_by_package():
    text = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| `blurmatte(?:\.(\w+))?` \| (.*) \|$", text)
    listed = [
        f"{package}.{name}".lstrip(".")
        for package, names in rows
        for name in re.findall(r"`(\w+)`", names)
    ]
    assert sorted(listed) == LIST


def documented():
    """Public functions and classes, and the public methods and properties of the latter."""
    for name, thing in PUBLIC.items():
        if inspect.isroutine(thing):
            yield pytest.param(thing, id=name)
        elif inspect.isclass(thing):
            yield pytest.param(thing, id=name)
            for member, value in vars(thing).items():
                if member.startswith("_") or not _is_code(value):
                    continue
                yield pytest.param(getattr(thing, member), id=f"{name}.{member}")


def _is_code(value):
    return inspect.isroutine(value) or isinstance(value, property | classmethod | staticmethod)


@pytest.mark.parametrize("thing", list(documented()))
def test_everything_public_has_a_docstring(thing):
    text = thing.__doc__
    assert text
    assert text.strip()
    if inspect.isclass(thing):
        assert not text.startswith(f"{thing.__name__}(")  # what dataclass puts where there is none


@pytest.mark.parametrize(
    "thing", [pytest.param(t, id=n) for n, t in PUBLIC.items() if inspect.isfunction(t)]
)
def test_documented_arguments_are_the_real_ones(thing):
    names = list(inspect.signature(thing).parameters)
    text = inspect.getdoc(thing)
    if "Parameters\n----------\n" not in text:
        return
    section = text.split("Parameters\n----------\n")[1].split("\n\n")[0]
    heads = [line.split(" :")[0] for line in section.splitlines() if not line.startswith(" ")]
    assert [name.lstrip("*") for head in heads for name in head.split(", ")] == names


def printed(code):
    """The output of a new interpreter."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_import_loads_no_other_package():
    names = "{'numpy', 'numba', 'scipy', 'PIL', 'OpenImageIO', 'matplotlib', 'rich', 'av'}"
    assert printed(f"import sys, blurmatte; print(*({names} & set(sys.modules)))") == ""


def test_import_of_all_public_names_loads_no_heavy_package():
    """Exact: of scipy only the package, which loads a subpackage when it is first used; of Pillow
    only numbers of tags."""
    scipy = "'scipy.linalg', 'scipy.ndimage', 'scipy.optimize', 'scipy.sparse', 'scipy.special'"
    names = f"{{'numba', {scipy}, 'PIL.Image', 'OpenImageIO', 'matplotlib', 'rich', 'av'}}"
    code = f"import sys, blurmatte as bm, operator; [operator.attrgetter(n)(bm) for n in {LIST}]; "
    code += f"print(*({names} & set(sys.modules)))"
    assert printed(code) == ""


def test_public_function_is_not_hidden_by_the_package_of_its_name():
    code = "import blurmatte.explain.explain, blurmatte; print(callable(blurmatte.explain))"
    assert printed(code) == "True"


def test_unknown_name_raises_attribute_error():
    with pytest.raises(AttributeError, match="module 'blurmatte' has no attribute 'solver'"):
        bm.solver  # noqa: B018


PICTURE = bm.LinearImage(np.full((9, 12, 3), 0.5))
LENS = bm.Intrinsics.from_focal_length(50, (12, 9))
SIGHTINGS = [bm.motion.FrameSightings(0, 0.0, ())]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: bm.sweep.fit_sweep(PICTURE, PICTURE, "all"), "streak must be a Streak"),
        (
            lambda: bm.sweep.fit_sweep(PICTURE, PICTURE, model="#d8ff3c"),
            "model must be a ColorModel",
        ),
        (lambda: bm.sweep.fit_sweep(PICTURE, PICTURE, start="#d8ff3c"), "start must be a Sweep"),
        (lambda: bm.solve(PICTURE, PICTURE, start=LENS), "start must be a Sweep"),
        (lambda: bm.solve(PICTURE, PICTURE, out="a.png"), "out must be a PixelMaps"),
        (lambda: bm.sweep.fit_transfer("a.png", PICTURE), "image must be a LinearImage"),
        (
            lambda: bm.sweep.fit_transfer(PICTURE, PICTURE, curves=["srgb"]),
            "a curve must be a Transfer",
        ),
        (lambda: bm.calibration.fit_noise(PICTURE, "a.png"), "plate must be a LinearImage"),
        (lambda: bm.calibration.measure_noise(["a.png", "b.png"]), "frame 1 must be a LinearImage"),
        (lambda: bm.calibration.measure_noise([PICTURE, "b.png"]), "frame 2 must be a LinearImage"),
        (
            lambda: bm.calibration.measure_noise_against("a.png", PICTURE),
            "picture must be a LinearImage",
        ),
        (
            lambda: bm.calibration.measure_noise_within(0, PICTURE.valid),
            "picture must be a LinearImage",
        ),
        (lambda: bm.make_plate(["a.png"] * 3), "the first frame must be a LinearImage"),
        (lambda: bm.make_plate([PICTURE, "b.png", "c.png"]), "frame 1 must be a LinearImage"),
        (
            lambda: bm.motion.sightings(["a.png"], PICTURE, bm.ColorModel.any()),
            "a frame must be a Linear",
        ),
        (lambda: bm.motion.sightings([PICTURE], PICTURE, "#d8ff3c"), "model must be a ColorModel"),
        (lambda: bm.measure_clip([PICTURE], model="#d8ff3c"), "model must be a ColorModel"),
        (lambda: bm.motion.link_sightings(PICTURE.rgb), "each of frames must be a FrameSightings"),
        (lambda: bm.motion.fit_fall(SIGHTINGS), "each of rows must be a FrameMotion"),
        (lambda: bm.motion.fit_fall([], scale=0.001), "scale must be a Scale"),
        (lambda: bm.motion.frame_scatter(SIGHTINGS), "each of rows must be a FrameMotion"),
        (
            lambda: bm.motion.places_in_space([], "lens.json", 0.02),
            "intrinsics must be a Intrinsics",
        ),
        (
            lambda: bm.motion.fit_ball(PICTURE, PICTURE, "lens.json", 0.02),
            "intrinsics must be a Intrin",
        ),
        (
            lambda: bm.motion.fit_ball(PICTURE, PICTURE, LENS, 0.02, sweep=1),
            "sweep must be a Sweep",
        ),
        (
            lambda: bm.motion.Plane.from_points([], [], "lens.json"),
            "intrinsics must be a Intrinsics",
        ),
        (lambda: bm.motion.measure_on_plane(None, "plane"), "plane must be a Plane"),
        (lambda: bm.Scale.from_radius("a", 0.02), "motion must be a Motion"),
        (lambda: bm.motion.end_silhouettes(PICTURE, None), "solution must be a Solution"),
        (lambda: bm.figures.draw_motion(PICTURE, PICTURE, None), "solution must be a Solution"),
        (
            lambda: bm.figures.draw_overview(PICTURE, "plate.png", None),
            "plate must be a LinearImage",
        ),
        (lambda: bm.save_results("out", PICTURE, PICTURE, None), "solution must be a Solution"),
        (lambda: bm.results.save_plate("out.png", PICTURE), "fit must be a PlateFit"),
        (lambda: bm.figures.draw_noise(bm.NoiseModel()), "fit must be a NoiseFit"),
        (lambda: bm.compositing.split_exposure(PICTURE, "#d02020"), "solution must be a Solution"),
        (lambda: bm.results.save_exposures("out", PICTURE, None), "exposures must be a Exposures"),
        (lambda: bm.compositing.cover("beach.jpg", (9, 9)), "picture must be a LinearImage"),
        (lambda: bm.compositing.light_gain(PICTURE, "plate.png"), "plate must be a LinearImage"),
        (lambda: list(bm.compositing.fade_between(PICTURE, None)), "second must be a LinearImage"),
        (lambda: bm.remove(PICTURE, None, PICTURE.valid), "plate must be a LinearImage"),
        (lambda: bm.retouch(PICTURE, PICTURE, None), "layer must be a Layer"),
        (lambda: bm.motion.fit_fall_in_space([PICTURE]), "each of balls must be a BallPlace"),
        (lambda: bm.compositing.stack([PICTURE]), "layer 0 must be a Layer"),
        (lambda: bm.color.pick_colors("a.png", 3, 3), "image must be a LinearImage"),
        (
            lambda: bm.streaks.find_streak_within((0, 0, 3, 3), PICTURE, PICTURE),
            "region must be a Streak",
        ),
        (lambda: bm.streaks.Streak([[True]]), "mask must be a NumPy array, got list"),
        (lambda: bm.rendering.render("easy"), "scene must be a Scene"),
        (lambda: bm.rendering.Shot("easy"), "scene must be a Scene"),
        (lambda: bm.scenes.save_shot("out", "easy"), "shot must be a Shot"),
        (lambda: bm.scenes.score(PICTURE, None), "answer must be a ProgramAnswer"),
        (lambda: bm.radiometry.nearest_transfer("srgb"), "curve must be a Transfer"),
        (lambda: bm.radiometry.named_transfer(2.2), "name must be a str"),
        (lambda: bm.NoiseModel.rounding(256, "srgb"), "transfer must be a Transfer"),
        (lambda: bm.read_layers(["a.exr"], "srgb"), "transfer must be a Transfer"),
    ],
)
def test_wrong_type_of_an_argument_is_named(call, words):
    """Door: with the expected type, before any work."""
    with pytest.raises(TypeError, match=words):
        next(call())  # generators raise when the first item is requested
