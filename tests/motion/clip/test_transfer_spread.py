"""The transfer curve that a clip does not state: the error of radii, and frames that it spoils."""

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.clip.sightings import sighted
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.calibration import with_noise
from blurmatte.motion.clip.measure import explaining_curve, radius_spread
from blurmatte.radiometry import REC709, SRGB, LinearImage, Meta
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.plates import colorful_plate, plain_plate
from blurmatte.sweep.discs import fit_disc

RADIUS = 13.0
START, END = (30.0, 30.0), (60.0, 38.0)


def assumed(light):
    """Light of an sRGB file of 8 bits, read as Rec. 709."""
    codes = np.round(255 * SRGB.encode(np.clip(light, 0, 1))) / 255
    return LinearImage(REC709.decode(codes).astype(np.float32), meta=Meta(transfer=REC709))


@pytest.fixture(scope="module")
def scene():
    """A frame, a plate, and the row of the ball in it."""
    plate = plain_plate((96, 72), (0.12, 0.13, 0.16), 4)
    ball = bm.rendering.Ball(RADIUS, color=(0.8, 0.6, 0.2), ambient=1.0)
    truth = on_line(plate, START, END, ball)
    noise = np.random.default_rng(1).normal(0, 0.004, (2, *truth.image.rgb.shape))
    seen = sighted((45, 34), (30.0, 8.0), radius=RADIUS, ends=(START, END))
    row = bm.motion.FrameMotion(4, 0.1, seen, 1)
    return assumed(truth.image.rgb + noise[0]), assumed(truth.plate.rgb + noise[1]), row


def test_spread_of_the_radius_covers_the_true_curve(scene):
    """Honest: the radius with the wrong curve is off by no more than twice the spread."""
    frame, plate, row = scene
    spread = radius_spread([frame], plate, [row], [4])
    streak = bm.find_streaks(frame, plate)[0]
    wrong = fit_disc(*with_noise(frame, plate), streak).radius
    assert 0.002 < spread < 0.03
    assert abs(np.log(wrong / RADIUS)) < 2 * spread


def at_border(seen):
    return replace(seen, measured=replace(seen.measured, at_border=True))


def test_spread_is_unknown_without_whole_frames(scene):
    """Exact: at the border."""
    frame, plate, row = scene
    cut = replace(row, sighting=at_border(row.sighting))
    assert radius_spread([frame], plate, [cut], [4]) == 0


def refused(body, noise=0.0015):
    """A gray frame of little noise with its plate, and the row of a frame without a disc."""
    light = colorful_plate((112, 88), 3, tile=14)[..., :1]
    plate = np.repeat(0.01 + 0.85 * (light / light.max()) ** 2, 3, axis=-1)
    truth = on_line(plate, (36.0, 36.0), (68.0, 48.0), body)
    rng = np.random.default_rng(0)
    frame, behind = (
        assumed(picture.rgb + noise * rng.normal(size=(88, 112, 1)))
        for picture in (truth.image, truth.plate)
    )
    why = "no disc on a path explains the streak, and without a color nothing else can be measured"
    return [frame], behind, [bm.motion.FrameMotion(0, 0.0, None, None, reason=why)]


def test_curve_is_named_with_which_a_disc_explains_a_frame():
    """Exact: the frame is of sRGB; a frame that agrees with the plate shows no curve."""
    frames, plate, rows = refused(bm.rendering.Ball(12.0, (0.5, 0.5, 0.5)))
    pair = with_noise(frames[0], plate)
    assert fit_disc(*pair, bm.find_streaks(*pair)[0]).rejection
    found = explaining_curve(frames, plate, rows)
    assert found is not None
    assert found.name == "srgb"
    nothing = [replace(rows[0], reason="nothing moved")]
    assert explaining_curve(frames, plate, nothing) is None


def test_no_curve_makes_a_disc_of_what_is_none():
    assert explaining_curve(*refused(Sheet(44, 12, (0.5, 0.5, 0.5)))) is None
