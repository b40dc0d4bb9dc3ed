"""What colors, solutions, plates, noise, curves and motions say, in plain words."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.color import ColorModel
from blurmatte.matting import Quality, Solution
from blurmatte.motion import (
    FreeFall,
    Motion,
    Scatter,
    SpaceMotion,
    Speed,
    fall_in_words,
    motion_in_words,
    scatter_in_words,
    space_motion_in_words,
    speed_in_words,
)
from blurmatte.radiometry import (
    BLOCKS,
    SRGB,
    NoiseFit,
    NoiseModel,
    ResponseFit,
    Transfer,
    nearest_transfer,
)

_MEDIUM_LIGHT = np.full(3, 0.2)
_OPEN = 30.0  # degrees: evidence that leaves more than this tells nothing worth a number
_APART = 1.5  # coherence of noise: chance makes less, in pictures that are not small
_EVIDENCE = {
    "hue variation": "the hues of the plate behind the streak alone",
    "shape": "the shape of the streak and the hues together",
    "compression": "hues in a file that lets the colors of neighbors run together",
    "feasibility": "alpha between 0 and 1, and no negative light, alone",
    "frames": "several frames together",
    "samples": "the scatter of the sampled colors alone",
}
_AGAINST = {
    Quality.SATURATED: "clipped",
    Quality.PLATE_IN_MODEL: "plate of the object's color",
    Quality.OUT_OF_RANGE: "alpha out of range",
    Quality.MISFIT: "not explained by the color model",
    Quality.SHADOW: "only darker, a shadow or something black",
    Quality.OCCLUDED: "behind something still",
}
_ANY = (
    "Any colors: alpha follows from the shape and its motion, or from the plate's texture, not from a "
    "color."
)
_ALL_SHADOW = (
    "Only light was lost: all of this may be a shadow, or an object that is black, or darker than the "
    "plate and of its hue; the picture cannot tell. Alpha holds only if something of the given color "
    "was there."
)
_MANY = 0.25  # of the streak's pixels: more than a few odd ones
_NOT_ALONE = 0.05  # of the known pixels: more than noise puts out of range
_SEEN = 1.0  # pixels: a rim that is softer is seen to be
_SMALL = 0.03  # of alpha: two answers that are nearer are one
_HIGHEST, _ABOVE = 1.02, 0.005  # alpha that may still be called 1; share of pixels beyond it
_REMEDY = {
    Quality.SATURATED: "is clipped in the image or the plate and cannot be known; expose shorter",
    Quality.PLATE_IN_MODEL: "lies before a plate of the object's own colors: nothing can be known "
    "there; allow fewer colors, or take the pictures before another background",
    Quality.SHADOW: "is only darker than the plate: a shadow, or something black, which the picture "
    "cannot tell; choose a region without it",
    Quality.MISFIT: "does not fit the color: pick the object's color where it is sharp or opaque, "
    "give two colors (rank 2), or choose a region that holds the object alone",
}


Explained = (
    ColorModel
    | Solution
    | PlateFit
    | NoiseFit
    | Transfer
    | ResponseFit
    | Motion
    | Speed
    | SpaceMotion
    | FreeFall
    | Scatter
)


def explain(thing: Explained) -> list[str]:
    """Sentences about what was found or measured, for people who do not know the words.

    Parameters
    ----------
    thing : ColorModel, Solution, PlateFit, NoiseFit, Transfer, ResponseFit, Motion, Speed, \
            BallMotion, PlaneMotion, BlurDepth, Rotation, FreeFall or Scatter

    Returns
    -------
    list of str
        One sentence each.

    Raises
    ------
    TypeError
        For anything else.
    """
    if isinstance(thing, ColorModel):
        if thing.rank == 3:
            return [_ANY]
        return [_directions(thing), *_evidence(thing), *_possible(thing)]
    if isinstance(thing, Solution):
        peak = f"Alpha up to {alpha_peak(thing):.2f}."
        return [
            *doubts(thing),
            peak,
            *_sweep(thing),
            *_smooth(thing.stats),
            *_area(thing),
            *_match(thing.stats),
            *_noise(thing.stats),
            *_flags(thing),
            *_others(thing.stats),
        ]
    if isinstance(thing, PlateFit):
        return list(_plate(thing))
    if isinstance(thing, NoiseFit):
        return [*_sensor(thing), *_rounding(thing), *_coherence(thing), *_left_out(thing)]
    if isinstance(thing, Transfer):
        return _curve(thing)
    if isinstance(thing, ResponseFit):
        return [*_curve(thing.transfer), *_response(thing)]
    if isinstance(thing, Motion):
        return motion_in_words(thing)
    if isinstance(thing, Speed):
        return speed_in_words(thing)
    if isinstance(thing, SpaceMotion):
        return space_motion_in_words(thing)
    if isinstance(thing, FreeFall):
        return fall_in_words(thing)
    if isinstance(thing, Scatter):
        return scatter_in_words(thing)
    raise TypeError(
        "can explain a ColorModel, a Solution, a PlateFit, a NoiseFit, a Transfer, a ResponseFit, a "
        "Motion, a Speed, a BallMotion, a PlaneMotion, a BlurDepth, a Rotation, a FreeFall or "
        f"a Scatter, got {type(thing).__name__}"
    )


def _plate(fit: PlateFit) -> Iterator[str]:
    plate, frames = fit.plate, len(fit.gain)
    free = fit.coverage[plate.valid]
    yield (
        f"{frames} frames; half of the pixels were free in {np.median(free):.0%} of them or more, "
        f"the rarest 1% in {np.quantile(free, 0.01):.0%}."
    )
    brightness = fit.gain.mean(axis=1)
    change = brightness.max() / brightness.min() - 1
    yield f"The light of the scene changed by {change:.1%}; that is divided out."
    std = np.sqrt(np.median(plate.variance[plate.valid], axis=0))
    light = np.median(plate.rgb[plate.valid], axis=0)
    steps = std / (SRGB.slope(light) / 255)
    yield (
        f"Noise of the plate: {steps.mean():.2f} of a step of 8-bit sRGB at the median pixel "
        f"({std.mean():.2g} of white)."
    )
    clipped = ~plate.valid & (fit.coverage > 0)
    unknown = ~plate.valid & (fit.coverage == 0)
    yield (
        f"Not known, for no light was seen much more often than others: {unknown.mean():.1%} of the "
        f"pixels. Clipped: {clipped.mean():.1%}."
    )


def _curve(curve: Transfer) -> list[str]:
    nearest, off = nearest_transfer(curve)
    black, middle, white = curve.decode(np.array([0, 0.5, 1]))
    return [
        f"Nearest to {nearest.name}, which is off by up to {off:.1%} of full scale.",
        f"Light {black:.4g}, {middle:.4g} and {white:.4g} at code values 0, 1/2 and 1.",
    ]


def _response(fit: ResponseFit) -> list[str]:
    low, high = fit.seen
    lines = [
        f"The light is known to {np.max(fit.std):.1%} of full scale (one standard deviation), "
        f"{np.max(fit.std[: len(fit.std) // 2]):.1%} in the darker half of the code values.",
        f"{fit.agreement:.0%} of the places agree; noise {255 * fit.noise:.2g} of 255 code values.",
        f"Code values {255 * low:.0f} to {255 * high:.0f} of 255 were seen twice; beyond them the "
        "curve is continued as cameras do.",
        "Exposure times as the pictures have them: "
        + ", ".join(f"{time:.3g} s" for time in fit.exposure_times)
        + ".",
    ]
    if not fit.channels_agree:
        worst = max(fit.channel_difference)
        lines.append(
            f"Red, green and blue do not have one curve: alone, one differs by up to {worst:.1%}; "
            "the camera mixes colors after the curve, and light is known no better than that."
        )
    return lines


def doubts(solution: Solution) -> list[str]:
    """What nobody should overlook: why a large part of the answer is unknown or cannot be true.

    One sentence each, with what to do; none for a sound solution.
    """
    inside = solution.quality[solution.streak]
    if not inside.size:
        return []
    if solution.stats.get("only_light_lost", False):
        return [_ALL_SHADOW]
    unknown = ~solution.known[solution.streak]
    shares = {
        flag: float(np.mean(((inside & flag) != 0) & (unknown | (flag != Quality.SATURATED))))
        for flag in _REMEDY
    }
    if (solution.stats.get("sweep") or {}).get("shadow") is not None:
        del shares[Quality.SHADOW]  # it is the object's own, as is said of it
    said = [f"{share:.0%} of the streak {_REMEDY[flag]}." for flag, share in shares.items()
            if share > _MANY]  # fmt: skip
    return _no_object(solution) or [*said, *_impossible(solution), *_rival(solution.stats)]


def _rival(stats: Mapping[str, Any]) -> list[str]:
    off = stats.get("rival_off", 0.0)
    if off <= _SMALL:
        return []
    return [
        "The color is told by hues alone; a shape that would explain most of the streak has an alpha "
        f"that differs by {off:.2f}, and the errors cover both: give the object's color to be sure."
    ]


def _no_object(solution: Solution) -> list[str]:
    total = solution.stats.get("sum_alpha")
    if total is None or total > 3 * _sum_std(solution):
        return []
    return [
        f"Alpha adds up to {total:.0f}, no more than nothing: what moved here does not have this "
        "color; choose the object with a region, or give its own color."
    ]


def _impossible(solution: Solution) -> list[str]:
    """Alpha far out of its range, by more than noise."""
    known = solution.streak & solution.known
    alpha, margin = solution.alpha[known], 3 * solution.alpha_std[known]
    if not alpha.size:
        return []
    above, below = np.mean(alpha > _HIGHEST + margin), np.mean(alpha < -margin)
    said = []
    if above > _ABOVE:
        said.append(
            f"Alpha goes up to {alpha_peak(solution):.2f}, which cannot be (above 1 in {above:.1%} "
            "of the streak): the color is too near to the plate's, or the plate does not fit."
        )
    if below > _NOT_ALONE:
        said.append(
            f"Alpha is below 0 in {below:.0%} of the streak, which cannot be: a shadow or another "
            "thing is in it, or the color is wrong."
        )
    return said


def alpha_peak(solution: Solution) -> float:
    """How far alpha goes up where it is known, but for the topmost half percent; 0 if nowhere."""
    alpha = solution.alpha[solution.streak & solution.known]
    return max(float(np.percentile(alpha, 99.5)), 0.0) if alpha.size else 0.0


def _directions(model: ColorModel) -> str:
    told = " and ".join(
        f"({', '.join(f'{x:.3f}' for x in color)})" for color in np.round(model.rgb, 3) + 0.0
    )
    space = "linear RGB" if model.to_srgb is None else "camera's own linear RGB"
    if model.rank == 1:
        return f"One paint and its shades: all multiples of the {space} color {told}."
    return f"Two paints and their mixtures: a plane of colors between {space} {told}."


def _evidence(model: ColorModel) -> list[str]:
    if not model.evidence:
        return ["The color was given, not measured."]
    sentences = []
    for name, std in model.evidence.items():
        source = _EVIDENCE.get(name, f"{name} alone")
        told = f"to {std:.2g}°" if std < _OPEN else "nothing"
        sentences.append(f"From {source}: {told}.")
    return sentences


def _possible(model: ColorModel) -> list[str]:
    """What else the color may be, if that can be told apart."""
    told = [" and ".join(other.hex) for other in model.possible]
    if len(set(told)) == 1:
        return []
    return [f"In 95 of 100 cases no further away than {told[1]} or {told[5]}."]


def _sweep(solution: Solution) -> list[str]:
    """What went where, if the shape of the streak told it."""
    sweep = solution.stats.get("sweep")
    if sweep is None:
        return []
    way = {"line": "a straight line", "arc": "an arc", "bounce": "a path that bounces"}
    kind = way.get(sweep["path"], "a curved path")
    radius = f"{sweep['radius']:.2f} ± {_rounded_std(sweep['radius_std'])} px"
    return [
        f"{_shape(sweep['silhouette'], radius)} on {kind} of {sweep['length']:.0f} px explains the "
        f"streak; {_left(sweep, solution.model)}.",
        *_softness(sweep.get("softness", 0)),
        *_shadow(sweep.get("shadow")),
        *_highlight(sweep.get("highlight")),
    ]


def _softness(softness: float) -> list[str]:
    if softness < _SEEN:
        return []
    return [f"The lens blurs its rim by {softness:.1f} px: it was not in focus as the plate is."]


def _highlight(highlight: Mapping[str, Any] | None) -> list[str]:
    if highlight is None:
        return []
    away = float(np.hypot(*highlight["offset"]))
    return [
        f"Of one paint, {highlight['paint']}, with a highlight {away:.0f} px from its middle: colors "
        "are those of both."
    ]


def _shadow(shadow: Mapping[str, Any] | None) -> list[str]:
    if shadow is None:
        return []
    away = float(np.hypot(*shadow["offset"]))
    taken = f"{100 * float(np.mean(shadow['strength'])):.0f} %"
    return [
        f"Its shadow, {away:.0f} px from it, takes {taken} of the light behind; it is not in alpha."
    ]


def _left(sweep: Mapping[str, Any], model: ColorModel) -> str:
    """How well a sweep explains the streak; of any colors, whether the plate's texture says so, too."""
    texture = sweep["texture"]
    if texture is not None:
        return f"the plate's texture in it confirms alpha to {_rounded_std(100 * texture)} %"
    left = f"what is left is {sweep['misfit']:.2g} times what noise leaves"
    if model.rank < 3:
        return left
    return f"{left}. No texture of the plate confirms alpha: shape and motion alone tell it"


def _smooth(stats: Mapping[str, Any]) -> list[str]:
    """How alpha was found, if no shape told it."""
    smooth = stats.get("smooth")
    if smooth is None:
        return []
    what = "change little" if smooth["order"] == 1 else "bend little"
    settled = "" if smooth["converged"] else " It had not settled yet: take a little care."
    return [f"All pixels were solved together, as alpha seems to {what} but for edges.{settled}"]


def _shape(silhouette: str, radius: str) -> str:
    if silhouette == "disc":
        return f"A disc of radius {radius}"
    kind = "An ellipse" if silhouette.endswith("ellipse") else "A shape"
    turning = " that turns" if silhouette.startswith("turning") else ""
    return f"{kind}{turning} with the area of a disc of radius {radius}"


def _area(solution: Solution) -> list[str]:
    total = solution.stats.get("sum_alpha")
    if total is None:
        return []
    std = _sum_std(solution)
    said = f"Sum of alpha {total:.0f} ± {_rounded_std(std)}{_condition(solution.model)}"
    if total > 3 * std:
        radius = math.sqrt(total / math.pi)
        error = _rounded_std(std / (2 * math.pi * radius))
        said += ": the area of the silhouette in pixels, whatever the motion; "
        said += f"of a disc, the radius would be {radius:.1f} ± {error}"
    sentences = [said + "."]
    unknown = solution.stats.get("pixels", 0) - solution.stats.get("pixels_known", 0)
    if unknown:
        sentences.append(f"{unknown} pixels of the streak are unknown and not in the sum.")
    if _touches_border(solution):
        sentences.append("The streak touches the border; the sum lacks what lies beyond.")
    return sentences


def _sum_std(solution: Solution) -> float:
    """Of the sum of alpha: from the noise, and from the color."""
    stats = solution.stats
    by_color = stats.get("sum_alpha", 0) * stats.get("alpha_scale_std", 0)
    return math.hypot(stats.get("sum_alpha_std", 0), by_color)


def _condition(model: ColorModel) -> str:
    """What the sum rests on, beside the noise."""
    if not model.evidence and model.rank < 3:
        return ", if the given color is right"
    if set(model.evidence) == {"samples"}:
        return ", if the sampled pixels show nothing but the object"
    return ""


def _rounded_std(std: float) -> str:
    return f"{std:.0f}" if std >= 1 else f"{std:.1g}"


def _touches_border(solution: Solution) -> bool:
    x0, y0, x1, y1 = solution.stats.get("streak_box", (1, 1, 1, 1))
    width, height = solution.size
    return bool(min(x0, y0) == 0 or x1 == width or y1 == height)


def _match(stats: Mapping[str, Any]) -> list[str]:
    """How the plate was changed to match the image, and how well they agree now."""
    match = stats.get("match")
    if match is None:
        return []
    what = (
        "The plate was used as it is"
        if match["in_words"] == "plate as it is"
        else (f"The plate was matched to the image: {match['in_words']}")
    )
    return [
        f"{what}; where nothing moved, they agree to {match['agreement']:.2g} times their noise, at "
        f"edges to {match['edge_agreement']:.2g}."
    ]


def _noise(stats: Mapping[str, Any]) -> list[str]:
    spoken = [
        f"{_noise_std(stats[f'{name}_noise']):.2g} in the {name}"
        for name in ("image", "plate")
        if f"{name}_noise" in stats
    ]
    return [f"Noise (std, white is 1): {', '.join(spoken)}."] if spoken else []


def _noise_std(fields: Mapping[str, Any]) -> float:
    if "median_std" in fields:
        return float(fields["median_std"])
    return float(np.sqrt(NoiseModel(**fields).variance(_MEDIUM_LIGHT).mean()))


def _flags(solution: Solution) -> list[str]:
    inside = solution.quality[solution.streak]
    shares = (
        {flag: float(np.mean((inside & flag) != 0)) for flag in _AGAINST} if inside.size else {}
    )
    said = [f"{_AGAINST[flag]} {share:.1%}" for flag, share in shares.items() if share >= 0.0005]
    if not said:
        return ["Nothing is known against the streak's pixels."]
    return [f"Flagged in the streak: {', '.join(said)}."]


def _others(stats: Mapping[str, Any]) -> list[str]:
    count = len(stats.get("other_boxes", ()))
    if count == 0:
        return []
    return [f"{count} other {'thing' if count == 1 else 'things'} moved; choose one with a region."]


def _sensor(fit: NoiseFit) -> list[str]:
    """Gain, read noise, and what is a fraction of the light."""
    sensor, said = fit.sensor, []
    gain, relative = np.array(sensor.gain), np.array(sensor.relative_std)
    said.append(f"Gain, light per electron: {_channels(gain, fit.gain_std)}.")
    if np.all(gain > 3 * fit.gain_std) and np.max(fit.coherence) < _APART:
        electrons = _channels(1 / gain, fit.gain_std / gain**2)
        said.append(f"White is {electrons} electrons.")
    said.append(f"Read noise, 1 is white: {_channels(sensor.read_std, fit.read_std_std)}.")
    if np.any(relative > 3 * fit.relative_std_std):
        said.append(f"And this fraction of the light: {_channels(relative, fit.relative_std_std)}.")
    if not fit.parted:
        said.append(
            "The light is too even, or the noise too uncertain, to tell gain from read noise: only "
            "their sum is known; show dark and bright things."
        )
    return said


def _rounding(fit: NoiseFit) -> list[str]:
    if not np.any(fit.rounding.coefficients):
        return []
    share = float(np.mean(fit.rounding_share(_MEDIUM_LIGHT[0])))
    return [f"Rounding to code values makes {share:.2g} of the variance at light 0.2, besides."]


def _coherence(fit: NoiseFit) -> list[str]:
    """How noise hangs together."""
    if np.max(fit.coherence) < _APART:
        return ["Every pixel has noise of its own."]
    ratios = ", ".join(
        f"{size}x{size}: {ratio:.2g}"
        for size, ratio in zip(BLOCKS, fit.coherence.mean(axis=0), strict=True)
    )
    scale = ", ".join(f"{scale:.1f}" for scale in fit.scale)
    return [
        f"Noise hangs together over {scale} px (R, G, B), as compression, demosaicing, texture and "
        f"movement make it; over blocks it adds up to times its variance: {ratios}."
    ]


def _left_out(fit: NoiseFit) -> list[str]:
    if fit.changed < 0.001:
        return []
    return [f"{fit.changed:.1%} of the pixels changed by more than noise and were left out."]


def _channels(values: Any, errors: Any) -> str:
    """Three numbers with their errors."""
    return ", ".join(
        f"{_digits(value, error)} ± {_digits(error, error)}"
        for value, error in zip(values, errors, strict=True)
    )


def _digits(value: float, error: float) -> str:
    """As many digits as an error of two digits leaves meaning."""
    last = 1 - math.floor(math.log10(error)) if error > 0 else 6
    return f"{round(value, last):.{max(last, 0)}f}"
