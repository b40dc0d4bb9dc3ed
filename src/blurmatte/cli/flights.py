"""What a clip says of space: a ball of known size before a calibrated camera, in every frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import blurmatte as bm
from blurmatte.cli.program import with_progress
from blurmatte.cli.space import Quantity, true_radius

Places = Sequence[bm.BallPlace | None]


@dataclass(frozen=True, eq=False)
class KnownBall:
    """A ball before a camera, as the options tell them; the radius with its error, meters.

    `line_time` is that of a rolling shutter, seconds.
    """

    lens: bm.Intrinsics
    radius: Quantity
    line_time: float

    def places(
        self,
        frames: bm.Frames[bm.LinearImage],
        plate: bm.LinearImage,
        rows: Sequence[bm.FrameMotion],
        model: bm.ColorModel,
        workers: bm.Workers,
    ) -> Places:
        """Where it was in each frame, or each of several."""
        fits = bm.fit_balls(frames, plate, rows, model, self.lens, *self.radius, workers=workers)
        balls = list(with_progress(fits, "in space", len(rows)))
        return bm.places_in_space(
            rows, self.lens, *self.radius, balls=balls, line_time=self.line_time
        )

    def moved(
        self, ball: bm.BallPlace | None, seen: bm.Sighting | None
    ) -> tuple[float, float] | None:
        """How far within the exposure, meters, and its error; of a disc across the line of sight."""
        if ball is None or seen is None:
            return None
        if ball.length is not None and ball.length_std is not None:
            return ball.length, ball.length_std
        pixel = ball.distance / float(self.lens.magnification(seen.place))
        far = seen.length * ball.distance_std / ball.distance
        return pixel * seen.length, pixel * math.hypot(seen.length_std, far)


def known_ball(
    camera: Path | None,
    radius: str | None,
    diameter: str | None,
    others: Sequence[str | None],
    line_time: float,
) -> KnownBall | None:
    """What the options say of a ball in space, before anything else is read; None without a camera.

    Parameters
    ----------
    camera, radius, diameter
        As they were typed.
    others : sequence of str or None
        Options that would give one scale for all frames.
    line_time : float
        Seconds.
    """
    if camera is None:
        return None
    if any(text is not None for text in others) or (radius and diameter):
        raise ValueError(
            "with --camera a clip needs the ball's true size alone, --radius or --diameter; how large "
            "a pixel is follows in each frame from how far away the ball was"
        )
    size = true_radius(radius, diameter)
    if size is None:
        raise ValueError(
            "--camera needs --radius or --diameter, the ball's true size; if nobody knows it, guess, "
            "and give --gravity: the fall says by how much all lengths must be multiplied"
        )
    return KnownBall(bm.read_intrinsics(camera), size, line_time)


def in_space_words(rows: Sequence[bm.FrameMotion], places: Places) -> list[str]:
    """Where it was and how fast, in sentences."""
    found = sum(row.sighting is not None for row in rows)
    balls = [ball for ball in places if ball is not None]
    sound = [ball for ball in balls if not ball.doubted]
    told = [f"In space in {len(balls)} of {found} frames: {_how(balls)}."]
    if not sound:
        return told
    first, last = sound[0], sound[-1]
    told.append(
        f"From {_at(first)} to {_at(last)}; x is right, y down, z forward from the camera. "
        + _errors(sound)
    )
    return [*told, _speeds(sound)]


def _how(balls: Sequence[bm.BallPlace]) -> str:
    """What places were made of."""
    fitted = sum(ball.source == "ball" for ball in balls)
    discs = sum(ball.source == "sweep" for ball in balls)
    moments, doubted = len(balls) - fitted - discs, sum(ball.doubted for ball in balls)
    told = [f"{fitted} by a ball that was fitted to the picture"]
    if discs:
        told.append(f"{discs} by a disc")
    if moments:
        told.append(f"{moments} by moments of alpha, whose errors know neither shading nor codec")
    if doubted:
        told.append(f"of the {doubted} in doubt nothing else is made")
    return ", ".join(told)


def _at(ball: bm.BallPlace) -> str:
    return f"({', '.join(f'{value:.4g}' for value in ball.place)}) m"


def _errors(sound: Places) -> str:
    """Of the distance, and where it comes from."""
    balls = [ball for ball in sound if ball is not None]
    shapes = [ball for ball in balls if ball.source != "moments"]
    if not shapes:
        return "How well single pictures tell the distance, moments of alpha do not say."
    picture = max(float(ball.picture_covariance[2, 2]) ** 0.5 / ball.distance for ball in shapes)
    shared = max(ball.shared for ball in balls)
    if shared == 0:
        return (
            f"Single pictures tell the distance to {picture:.2%} or better; the errors of radius and "
            "camera, which all share, were not given."
        )
    return (
        f"Single pictures tell the distance to {picture:.2%} or better, radius and camera all of them "
        f"to {shared:.1%}."
    )


def _speeds(sound: Sequence[bm.BallPlace]) -> str:
    fast = sorted((b for b in sound if b.velocity is not None), key=lambda ball: ball.speed)
    if not fast:
        return (
            "How fast in space is not known: that needs three frames of a track, and their times "
            "(--rate, for pictures)."
        )
    low, high = (f"{ball.speed:.3g} ± {ball.speed_std:.2g} m/s" for ball in (fast[0], fast[-1]))
    return f"Its speed in space, from frame to frame, was between {low} and {high}."
