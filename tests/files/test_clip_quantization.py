"""Quantizers of codecs, as FFmpeg exports them."""

import numpy as np
import pytest
from tests.encoders import encoder

import blurmatte as bm
from blurmatte.calibration import with_noise

SIZE = (64, 48)


def clip(path, codec, options, count=4):
    """A still scene of white noise, coded by a codec with some options."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
    with encoder(path, codec, SIZE, options=options) as (_, add):
        for _ in range(count):
            add(picture)
    return bm.read_frames(path, bm.radiometry.REC709)


@pytest.mark.parametrize(("qp", "step"), [(16, 0.625 * 2 ** (16 / 6)), (28, 0.625 * 2 ** (28 / 6))])
def test_noise_in_h264_has_the_error_of_its_quantizer(tmp_path, qp, step):
    # exact: white noise has many steps at all frequencies
    error = (
        clip(tmp_path / "clip.mp4", "libx264", {"x264-params": f"qp={qp}:ipratio=1"})
        .coding_errors()
        .still
    )
    assert error.blocks.shape == (6, 8, 3)
    luma = step**2 / 9 / 219**2
    assert error.blocks[..., 1].mean() > luma
    assert error.blocks.mean() == pytest.approx(3.0 * luma, rel=0.3)


def test_quantizers_of_mpeg4_are_known(tmp_path):
    small, large = (
        clip(tmp_path / f"{q}.avi", "mpeg4", {"qmin": str(q), "qmax": str(q)}).coding_errors().still
        for q in (2, 8)
    )
    assert large.blocks.mean() / small.blocks.mean() == pytest.approx(16, rel=0.2)


def test_no_error_is_stated_without_quantizers(tmp_path):
    assert clip(tmp_path / "clip.avi", "ffv1", {}).coding_errors() is None
    for k in range(3):
        bm.write(tmp_path / f"p{k}.png", bm.LinearImage(np.full((48, 64, 3), 0.3, np.float32)))
    assert bm.read_frames(tmp_path / "p#.png").coding_errors() is None


def test_a_frame_has_the_noise_of_moving_blocks(tmp_path):
    # exact: beside that which is measured; in a part of the frame as in the whole
    frames = clip(tmp_path / "clip.mp4", "libx264", {"x264-params": "qp=28"})
    plate = bm.LinearImage(frames[0].rgb, bm.NoiseModel())
    noisy, _ = with_noise(frames[1], plate)
    moving, light = frames.coding_errors().moving, plate.rgb
    coding = np.stack([moving.variance(light[..., c], c) for c in range(3)], axis=-1)
    measured, _ = bm.calibration.fit_noise(frames[1], plate)
    np.testing.assert_allclose(noisy.noise, measured.variance(light) + coding, rtol=1e-5)
    box = 16, 8, 56, 40
    part = frames[1].crop(box).meta.coding.variance(light[8:40, 16:56])
    np.testing.assert_array_equal(part, coding[8:40, 16:56].astype(np.float32))
