"""Colors of light; pictures, maps, lines, ellipses and figures of matplotlib as pixels."""

from typing import Any

import numpy as np

from blurmatte.checks import AnyArray, Array, Codes8, Floats
from blurmatte.errors import optional_library
from blurmatte.figures import style
from blurmatte.radiometry import SRGB, LinearImage

Color = tuple[int, int, int]


def srgb_codes(light: AnyArray) -> Codes8:
    """Clipped sRGB codes of linear light."""
    return np.asarray(np.rint(255 * SRGB.encode(np.clip(light, 0, 1))), dtype=np.uint8)


def color_of_hex(color: str) -> Color:
    """Codes of #rrggbb."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def swatch(color: str, shape: tuple[int, int]) -> Codes8:
    """(H, W, 3) codes of one color, #rrggbb."""
    return np.broadcast_to(np.array(color_of_hex(color), np.uint8), (*shape, 3))


def heat_codes(values: Floats) -> Codes8:
    """(H, W, 3) colors of the heat scale for values 0…1 (H, W)."""
    stops = np.arange(len(style.HEAT))
    position = values * stops[-1]
    heat = np.array(style.HEAT, float)
    return np.stack([np.interp(position, stops, c) for c in heat.T], axis=-1).astype(np.uint8)


def checkerboard(shape: tuple[int, ...]) -> Floats:
    """(H, W, 3) linear light of a dark checkerboard, as background of a layer."""
    tile = max(2, min(shape) // 12)
    y, x = np.ogrid[: shape[0], : shape[1]]
    light = np.where((y // tile + x // tile) % 2, 0.2, 0.16).astype(np.float32)
    return np.asarray(light[..., None].repeat(3, axis=-1))


def light_of_codes(codes: AnyArray) -> Floats:
    """Linear light of sRGB codes."""
    return np.asarray(SRGB.table(256).astype(np.float32)[codes])


def rescaled(pixels: Codes8 | Floats, scale: int) -> Codes8:
    """Codes of pixels enlarged `scale` times, or for −n averaged over n x n pixels in linear light.

    Pixels that are linear light are encoded only once they are as few as shown.
    """
    codes = pixels if pixels.dtype == np.uint8 else None
    if scale > 0:
        shown = srgb_codes(pixels) if codes is None else codes
        return np.asarray(shown.repeat(scale, axis=0).repeat(scale, axis=1))
    rows, columns = (np.arange(0, side, -scale) for side in pixels.shape[:2])
    light = np.clip(pixels, 0, 1) if codes is None else light_of_codes(codes)
    total = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    count = np.outer(
        *(np.diff([*at, side]) for at, side in zip((rows, columns), pixels.shape, strict=False))
    )
    return srgb_codes(total / count[..., None])


def fitted(image: LinearImage, room: tuple[int, int], max_scale: float = 24) -> tuple[Any, float]:
    """The picture (PIL) enlarged or reduced to fit into `room` (width, height), and its scale."""
    from PIL import Image

    width, height = image.size
    scale = min(room[0] / width, room[1] / height, max_scale)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    method = Image.Resampling.BOX if not 1 < scale < 3 else Image.Resampling.BICUBIC
    channels = (np.ascontiguousarray(image.rgb[..., c], np.float32) for c in range(3))
    bands = [np.asarray(Image.fromarray(c).resize(size, method)) for c in channels]
    return Image.fromarray(srgb_codes(np.stack(bands, axis=-1))), scale


def draw_line(pen: Any, xy: Any, scale: float, color: Color = style.BRIGHT) -> None:
    """Draw a polyline through points (x, y) of a picture that is enlarged `scale` times."""
    points = [((x + 0.5) * scale, (y + 0.5) * scale) for x, y in xy]
    pen.line(points, fill=color, width=2, joint="curve")


def unit_circle() -> Array:
    """(65, 2) points of the unit circle, closed."""
    return np.stack([f(np.linspace(0, 2 * np.pi, 65)) for f in (np.cos, np.sin)], axis=1)


def principal_axes(covariance: Floats) -> Floats:
    """(n, n) half-axes of one standard deviation along the eigenvectors of a covariance, as rows."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(np.sqrt(np.maximum(values, 0))[:, None] * axes.T)


def error_ellipse(center: Floats, covariance: Floats, enlargement: float) -> Floats:
    """(65, 2) points of the ellipse of one standard deviation around `center` (x, y), enlarged."""
    return np.asarray(center + enlargement * unit_circle() @ principal_axes(covariance))


def ellipse_enlargement(std: float, room: float) -> float:
    """The largest power of ten, at least 1, whose product with `std` is at most `room`."""
    return float(10.0 ** max(0, np.floor(np.log10(room / max(std, 1e-6)))))


def round_up(value: float) -> float:
    """`value` rounded up to two digits; 1 if it is not positive or not finite."""
    if not (np.isfinite(value) and value > 0):
        return 1.0
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / step - 1e-9) * step:.2g}")


def plot_library() -> Any:
    """The class of figures of matplotlib; raises BlurmatteError if that is not installed."""
    needed = 'a plot needs matplotlib: pip install "blurmatte[plot]"'
    return optional_library("matplotlib.figure", needed).Figure


def new_figure(size: tuple[float, float], dpi: int) -> Any:
    """An empty figure of matplotlib, inches; raises BlurmatteError if that is not installed."""
    return plot_library()(size, dpi, layout="constrained")


def sheet_style(figure: Any) -> Any:
    """Context in which a figure and its axes, until they are pixels, look like a sheet."""
    from matplotlib import rc_context

    ground, text, line = (
        "#{:02x}{:02x}{:02x}".format(*color)
        for color in (style.GROUND, style.BRIGHT, style.NEUTRAL)
    )
    figure.set_facecolor(ground)
    settings: Any = (
        {"axes.facecolor": ground}
        | dict.fromkeys(("text.color", "axes.labelcolor"), text)
        | dict.fromkeys(("xtick.color", "ytick.color", "axes.edgecolor", "grid.color"), line)
        | dict.fromkeys(("xtick.labelcolor", "ytick.labelcolor"), text)
    )
    return rc_context(settings)


def figure_pixels(figure: Any) -> Codes8:
    """(H, W, 3) sRGB of a figure of matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba(), np.uint8)[..., :3]
