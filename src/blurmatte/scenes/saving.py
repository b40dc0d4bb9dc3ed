"""Shot → a folder with the pictures to solve and their ground truth.

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
"""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import Codes8, check_kind
from blurmatte.files import path_to_mapping, write_together
from blurmatte.layer import Layer
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Camera, Rendering, Shot, encode_codes, render

SUBFRAMES = 8  # as in the benchmark of fast-moving objects
SHOT_FILES = (
    *("image.png", "image.exr", "plate.png", "plate.exr", "overview.png", "scene.toml"),
    *("truth/layer.exr", "truth/image.exr", "truth/plate.exr", "truth/shadow.exr"),
    *("truth/nearby.exr", "truth/model.json", "truth/path.json", "truth/truth.json"),
    *(f"truth/subframe_{n:02}.exr" for n in range(SUBFRAMES)),
)


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
