"""Render the pictures in examples/: one ball in front of two walls, with the truth.

Run it from anywhere: python scripts/make_examples.py. Same script, same bytes.
"""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import (
    Ball,
    Rendering,
    Scene,
    colorful_plate,
    render,
)
from blurmatte.rendering.camera import noisy
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.processing import encode_codes
from blurmatte.trajectory import Trajectory

SIZE = (400, 300)
SEED = 36
NOISE = NoiseModel(gain=2e-5, read_std=0.0008)
BALL = Ball(18, np.array([0.95, 0.50, 0.03]), ambient=0.4, lamps=(Lamp((-0.4, -0.6, 0.9)),))
PATH = Trajectory.arc((118, 196), (200, 140), (274, 118))
PLATES = {
    "colorful": colorful_plate(SIZE, SEED),
    "plain": plain_plate(SIZE, (0.10, 0.20, 0.24), SEED),
}


def write_png(path: Path, codes: np.ndarray, color_space: str) -> None:
    """Write (H, W, channels) uint16 codes, declared as `color_space`."""
    height, width, channels = codes.shape
    spec = oiio.ImageSpec(width, height, channels, "uint16")
    spec.attribute("oiio:ColorSpace", color_space)
    spec.attribute("png:compressionLevel", 9)
    file = oiio.ImageOutput.create(str(path))
    if not (file.open(str(path), spec) and file.write_image(codes) and file.close()):
        raise OSError(f"{path}: {file.geterror()}")


def truth(rendering: Rendering) -> dict[str, object]:
    """The true values, to compare an answer with."""
    return {
        "radius": BALL.radius,
        "color": BALL.color.tolist(),
        "ambient": BALL.ambient,
        "lamp": BALL.lamps[0].direction,
        "color_hex": rendering.model.hex[0],
        "alpha_sum": round(float(rendering.layer.alpha.sum()), 6),
        "path_length": round(PATH.length, 4),
        "trajectory": {"xy": PATH.xy.round(4).tolist(), "t": PATH.t.round(6).tolist()},
        "noise": {"gain": NOISE.gain[0], "read_std": NOISE.read_std[0]},
        "seed": SEED,
        "units": "pixels, x right, y down, pixel centers at whole numbers; light: linear, 1 white; "
        "color_hex: sRGB-coded, brightest channel at ff; t: fraction of the exposure",
    }


def main() -> None:
    """Render, photograph and write every scene."""
    for name, plate in PLATES.items():
        folder = Path(__file__).parent.parent / "examples" / name
        folder.mkdir(parents=True, exist_ok=True)
        rendering = render(Scene(plate, PATH, BALL))
        rng = np.random.default_rng(SEED)
        for file, picture in (("image.png", rendering.image), ("plate.png", rendering.plate)):
            codes = encode_codes(noisy(picture.rgb, NOISE, rng), 16)
            write_png(folder / file, codes, "sRGB")
        alpha = np.rint(65535 * rendering.layer.alpha).astype(np.uint16)
        write_png(folder / "alpha.png", alpha[..., None], "linear")
        (folder / "truth.json").write_text(json.dumps(truth(rendering), indent=1) + "\n")
        print(f"{folder.name}: {rendering}")


if __name__ == "__main__":
    main()
