"""PyMatting on the archive of scenes: an example of an adapter, which needs nothing of blurmatte.

PyMatting separates foreground from background by a trimap. Here it is made of image and plate: pixels
that agree are background, those that differ most are foreground, the rest of the streak is unknown. (In
docs/results trimaps are made of the truth: an upper bound of what PyMatting can do.)

Run: blurmatte render --archive --out scenes.zip && unzip scenes.zip -d scenes
     python -m benchmarks.adapters.pymatting_trimap scenes/ results/
     blurmatte score results/ --truth scenes/
"""

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import binary_dilation, gaussian_filter, label

_SMOOTH = 1.5  # pixels: standard deviation of the Gaussian over which a difference is averaged
_MIN_STDS = 6.0  # of the difference where nothing moved
_RIM = 4  # pixels around the streak that are unknown
_FOREGROUND = 95.0  # percentile of the difference in the streak above which it is foreground
_MARGIN = 24  # pixels of background that the solver sees


def main(scenes: Path, results: Path) -> None:
    """Solve every scene; one that cannot be solved is a miss."""
    for truth in sorted(scenes.glob("**/truth")):
        scene = truth.parent
        folder = results / scene.relative_to(scenes)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            save(folder / "layer.png", *solved(picture(scene, "image"), picture(scene, "plate")))
            print(folder, flush=True)
        except ValueError as error:
            print(f"{folder}: {error}", file=sys.stderr)


def picture(scene: Path, name: str) -> np.ndarray:
    """(H, W, 3) code values of sRGB, 0…1; an EXR holds linear light."""
    path = next(scene.glob(f"{name}.*"))
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]
    if path.suffix != ".exr":
        return np.asarray(pixels, float)
    light = np.clip(pixels, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def trimap_of(image: np.ndarray, plate: np.ndarray) -> np.ndarray:
    """(H, W) 0 where image and plate agree, 1 where they differ most, 0.5 between.

    Raises
    ------
    ValueError
        If nothing moved.
    """
    change = gaussian_filter(np.abs(image - plate).sum(axis=-1), _SMOOTH)
    middle = np.median(change)
    std = 1.4826 * np.median(np.abs(change - middle))
    parts, count = label(change > middle + _MIN_STDS * std)
    if count == 0:
        raise ValueError("image and plate agree")
    strength = np.bincount(parts.ravel(), change.ravel())
    streak = parts == 1 + int(np.argmax(strength[1:]))
    core = streak & (change >= np.percentile(change[streak], _FOREGROUND))
    return np.where(core, 1.0, np.where(binary_dilation(streak, iterations=_RIM), 0.5, 0.0))


def solved(image: np.ndarray, plate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Alpha (H, W) and the color of the object (H, W, 3), sRGB, by closed-form matting."""
    from pymatting import estimate_alpha_cf, estimate_foreground_ml

    trimap = trimap_of(image, plate)
    y, x = np.nonzero(trimap)
    place = tuple(slice(max(0, at.min() - _MARGIN), at.max() + _MARGIN) for at in (y, x))
    part = np.ascontiguousarray(image[place])
    alpha, color = np.zeros(trimap.shape), np.zeros(image.shape)
    alpha[place] = estimate_alpha_cf(part, trimap[place])
    color[place] = estimate_foreground_ml(part, alpha[place])
    return alpha, color


def save(path: Path, alpha: np.ndarray, color: np.ndarray) -> None:
    """Write straight color and alpha as 16-bit PNG."""
    pixels = np.clip(np.dstack([color, alpha]), 0, 1)
    height, width = alpha.shape
    spec = oiio.ImageSpec(width, height, 4, "uint16")
    spec["oiio:UnassociatedAlpha"], spec["oiio:ColorSpace"] = 1, "srgb_rec709_scene"
    target = oiio.ImageOutput.create(str(path))
    target.open(str(path), spec)
    target.write_image(np.rint(65535 * pixels).astype(np.uint16))
    target.close()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("give the folder of the scenes and one for the results: scenes/ results/")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
