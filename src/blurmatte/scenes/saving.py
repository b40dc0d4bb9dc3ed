"""Shots as folders with pictures and their ground truth, and as an archive for other programs.

========================  ==================================================================
image.png, plate.png      the camera's files; .exr for a camera that is not sRGB
scene.toml                the scene, if it was read from a file
overview.png              image, plate, true alpha and true color side by side
truth/layer.exr           true alpha and premultiplied light
truth/image.exr           the image without noise
truth/plate.exr           the plate behind the object, without noise and drift
truth/shadow.exr          fraction of the plate's light that the shadow removes, if any
truth/nearby.exr          fraction of the plate's light removed near the object; negative: added
truth/subframe_00.exr …   sharp layers at the middles of equal parts of the exposure
truth/model.json          the object's color model, if it is a line or a plane
truth/path.json           its path and radius
truth/truth.json          parameters of the scene
========================  ==================================================================

All pictures of the truth are blurred by the optics of the camera, a linear operator.

An archive holds no photographs of others, and neither what can be computed from the rest (the truth
with and without the object) nor sheets. The plate of its truth is that of the camera. The same scenes
give the same bytes.
"""

import re
import zipfile
from collections.abc import Iterator, Mapping
from hashlib import sha256
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from blurmatte.checks import Codes8, check_kind
from blurmatte.files.atomic import replacing
from blurmatte.files.models import path_to_mapping
from blurmatte.files.writing import write_together
from blurmatte.layer import Layer
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Camera, Rendering, Shot, render
from blurmatte.rendering.processing import encode_codes
from blurmatte.scenes.reading import read_shots, scene_names, scene_text

SUBFRAMES = 8  # as in the benchmark of fast-moving objects
SHOT_FILES = (
    *("image.png", "image.exr", "plate.png", "plate.exr", "overview.png", "scene.toml"),
    *("truth/layer.exr", "truth/image.exr", "truth/plate.exr", "truth/shadow.exr"),
    *("truth/nearby.exr", "truth/model.json", "truth/path.json", "truth/truth.json"),
    *(f"truth/subframe_{n:02}.exr" for n in range(SUBFRAMES)),
)
SCENES = 40
SUMS = "SHA256SUMS"
_OMITTED = "overview.png", "truth/image.exr", "truth/plate.exr"
_SEED_STEP = 1000  # from the seed of a scene to that of its second plate and noise
_TIME = (1980, 1, 1, 0, 0, 0)  # of all files
_ABOUT = """Scenes of moving objects with a known answer, rendered by blurmatte (MIT license).

image.png and plate.png of each folder are the input (.exr: linear light), truth/ is the answer.
Write NAME/layer.png, layer.exr or alpha.png of each scene into a folder of your own, and score it:

    blurmatte score results/ --truth THIS_FOLDER

sha256sum -c SHA256SUMS checks the files. docs/scenes.md of blurmatte describes all of them.
"""


def save_shot(folder: str | Path, shot: Shot, scene_text: str = "") -> list[Path]:
    """Render and photograph a shot, and write its pictures and ground truth.

    Parameters
    ----------
    folder : str or Path
        Created if missing. Files of the same names are replaced, all or none.
    shot : Shot
    scene_text : str
        Text of its scene file, to be stored in the folder.

    Returns
    -------
    list of Path
        The written files.

    Raises
    ------
    FileError
        If the folder cannot be created or written to.

    Examples
    --------
    >>> files = bm.scenes.save_shot("again/throw", bm.rendering.Shot(scene, camera))
    >>> [file.name for file in files[:3]]
    ['image.png', 'plate.png', 'overview.png']
    """
    check_kind("shot", shot, Shot, "use blurmatte.scenes.read_shots(scene)[0]")
    rendering = render(shot.scene)
    image, plate = shot.photograph(rendering)
    through = shot.camera.through_optics
    contents = _picture("image", image, shot.camera) | _picture("plate", plate, shot.camera)
    contents |= {
        "overview.png": _strip(image, plate, rendering),
        "truth/layer.exr": _layer_through(shot.camera, rendering.layer),
        "truth/image.exr": LinearImage(through(rendering.image.rgb)),
        "truth/plate.exr": LinearImage(through(rendering.plate.rgb)),
        "truth/path.json": path_to_mapping(rendering.trajectory, _radius(shot)),
    }
    if rendering.model is not None:
        contents["truth/model.json"] = rendering.model
    if shot.scene.shadow is not None:
        contents["truth/shadow.exr"] = LinearImage(through(rendering.shadow))
    if shot.scene.nearby is not None:
        contents["truth/nearby.exr"] = LinearImage(through(rendering.nearby))
    if scene_text:
        contents["scene.toml"] = scene_text
    for n, frame in enumerate(rendering.subframes(SUBFRAMES)):
        contents[f"truth/subframe_{n:02}.exr"] = _layer_through(shot.camera, frame)
    contents["truth/truth.json"] = _numbers(shot, rendering)
    return write_together(folder, contents)


def _layer_through(camera: Camera, layer: Layer) -> Layer:
    """The layer blurred by the optics of the camera."""
    return Layer(camera.through_optics(layer.alpha), camera.through_optics(layer.premultiplied))


def _picture(name: str, picture: LinearImage, camera: Camera) -> dict[str, Any]:
    if camera.bits is None or camera.transfer is not SRGB:
        return {f"{name}.exr": picture}
    if camera.bits == 8:
        return {f"{name}.png": encode_codes(picture.rgb, 8)}
    return {f"{name}.png": picture}


def _strip(image: LinearImage, plate: LinearImage, truth: Rendering) -> Codes8:
    """Four pictures side by side, (H, 4 W, 3) sRGB codes."""
    alpha = np.rint(255 * truth.layer.alpha).astype(np.uint8)
    lights = (image.rgb, plate.rgb, truth.layer.straight())
    seen, empty, color = (encode_codes(light, 8).astype(np.uint8) for light in lights)
    return np.hstack([seen, empty, np.dstack(3 * [alpha]), color])


def _numbers(shot: Shot, truth: Rendering) -> dict[str, Any]:
    scene, path, alpha = shot.scene, truth.trajectory, truth.layer.alpha
    return {
        "size": list(scene.size),
        "body": repr(scene.body),
        "radius": _radius(shot),
        "alpha_sum": float(alpha.sum()),
        "alpha_peak": float(alpha.max()),
        "path_length": path.length,
        "camera": repr(shot.camera),
        "drift": repr(shot.drift),
        "plate_frames": shot.plate_frames,
        "crf": shot.crf,
        "seed": shot.seed,
        "blurmatte": version("blurmatte"),
        "units": "pixels, x right, y down, pixel centers at whole numbers; light: linear, 1 white; "
        "t: fraction of the exposure; angles: radians",
    }


def _radius(shot: Shot) -> float:
    """Extent of the body from its center at the start, pixels."""
    return max(shot.scene.body.reach(shot.scene.pose(0)))


def archive_scenes() -> dict[str, str]:
    """Texts of the scenes of the archive, by their names.

    All built-in scenes of one picture without photographs, and then the first of them again, with
    another plate and other noise, up to forty in all.

    Examples
    --------
    >>> len(bm.scenes.archive_scenes())
    40
    """
    texts = {name: scene_text(name) for name in scene_names()}
    once = {
        name: text for name, text in texts.items() if '"photo"' not in text and "[clip]" not in text
    }
    return once | {
        f"{name}_2": re.sub(r"(?m)^seed = (\d+)", _next_seed, text)
        for name, text in islice(once.items(), SCENES - len(once))
    }


def save_archive(path: str | Path, scenes: Mapping[str, str] | None = None) -> Iterator[str]:
    """Render scenes and write them into one archive, with a list of checksums.

    Parameters
    ----------
    path : str or Path
        The archive, .zip.
    scenes : mapping of str to str, optional
        Names of folders and texts of scene files of one shot; `archive_scenes` by default.

    Yields
    ------
    str
        The name of each scene that is rendered. The archive exists when all are.

    Raises
    ------
    FileError
        If a scene is wrong, or the archive cannot be written.

    Examples
    --------
    >>> for name in bm.scenes.save_archive("scenes.zip"):  # doctest: +SKIP
    ...     print("rendered", name)
    """
    texts = archive_scenes() if scenes is None else scenes
    with (
        TemporaryDirectory(prefix="blurmatte-") as place,
        replacing(Path(path), ".zip") as temporary,
        zipfile.ZipFile(temporary, "w") as archive,
    ):
        sums = [_stored(archive, "README.txt", _ABOUT.encode())]
        for name, text in texts.items():
            file, folder = Path(place) / f"{name}.toml", Path(place) / name
            file.write_text(text, encoding="utf-8")
            save_shot(folder, read_shots(file)[0], text)
            for one in sorted(one for one in folder.rglob("*") if one.is_file()):
                inside = one.relative_to(folder).as_posix()
                if inside not in _OMITTED:
                    sums.append(_stored(archive, f"{name}/{inside}", one.read_bytes()))
            yield name
        _stored(archive, SUMS, "".join(sums).encode())


def _next_seed(found: re.Match[str]) -> str:
    return f"seed = {int(found[1]) + _SEED_STEP}"


def _stored(archive: zipfile.ZipFile, name: str, content: bytes) -> str:
    """Add a file, which is compressed already; its line of checksums."""
    entry = zipfile.ZipInfo(name, _TIME)
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)
    return f"{sha256(content).hexdigest()}  {name}\n"
