"""TIoU: computed by hand, compared with a grid of points, and its invariances."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from blurmatte.metrics import subframe_psnr, subframe_ssim, trajectory_iou
from blurmatte.trajectory import Trajectory

ARC = Trajectory.arc((10, 20), (40, 8), (70, 25))
BENT = Trajectory(np.array([[12, 22], [30, 10], [66, 20]]), np.array([0, 0.3, 1]))
BOTH = [subframe_psnr, subframe_ssim]


def shifted(path, step):
    return Trajectory(path.xy + step, path.t)


def reverse(path):
    return Trajectory(path.xy[::-1], 1 - path.t[::-1])


def test_tiou_of_the_truth_is_one():
    assert trajectory_iou(ARC, ARC, 5) == pytest.approx(1, abs=1e-12)


def test_tiou_at_one_radius_equals_that_computed_by_hand():
    """The lens of two discs at a distance of one radius: (2π/3 − √3/2) r²."""
    lens = 2 * np.pi / 3 - np.sqrt(3) / 2
    score = trajectory_iou(shifted(ARC, (3, 4)), ARC, 5)
    assert score == pytest.approx(lens / (2 * np.pi - lens))


def test_tiou_at_two_radii_is_zero():
    line = Trajectory.line((0, 0), (40, 0))
    assert trajectory_iou(shifted(line, (0, 10)), line, 5) == 0
    assert trajectory_iou(shifted(line, (0, 10.1)), line, 5) == 0
    assert trajectory_iou(shifted(line, (0, 9.9)), line, 5) > 0


def test_tiou_is_the_mean_over_time():
    """A path at rest at the true start: full overlap at first, none at the other two times."""
    line, still = Trajectory.line((0, 0), (100, 0)), Trajectory.line((0, 0), (0, 0))
    assert trajectory_iou(still, line, 5, samples=3) == pytest.approx(1 / 3)


def test_tiou_agrees_with_points_on_a_grid():
    """Points of a fine grid in both discs over those in either."""
    y, x = np.mgrid[0:40:0.05, 0:90:0.05]

    def disc(center):
        return np.hypot(x - center[0], y - center[1]) < 7

    scores = []
    for t in np.linspace(0, 1, 4):
        a, b = disc(ARC.at(t)), disc(BENT.at(t))
        scores.append(np.sum(a & b) / np.sum(a | b))
    assert 0.2 < np.mean(scores) < 0.8
    assert trajectory_iou(BENT, ARC, 7, samples=4) == pytest.approx(np.mean(scores), abs=1e-3)


def test_tiou_does_not_depend_on_the_direction_of_time():
    score = trajectory_iou(BENT, ARC, 7)
    assert trajectory_iou(reverse(BENT), ARC, 7) == pytest.approx(score)
    assert trajectory_iou(BENT, reverse(ARC), 7) == pytest.approx(score)
    assert trajectory_iou(reverse(ARC), ARC, 7) == pytest.approx(1, abs=1e-12)


def test_tiou_depends_on_the_speed_along_the_path():
    """The right path at wrong times is wrong."""
    early = Trajectory(np.array([[0, 0], [50, 0], [100, 0]]), np.array([0, 0.2, 1]))
    assert trajectory_iou(early, Trajectory.line((0, 0), (100, 0)), 5) < 0.4


def test_tiou_is_invariant_to_scale_rotation_and_exchange():
    turn = 3 * np.array([[0.6, 0.8], [-0.8, 0.6]])
    a, b = (Trajectory(path.xy @ turn + (7, -9), path.t) for path in (BENT, ARC))
    score = trajectory_iou(BENT, ARC, 7)
    assert trajectory_iou(a, b, 21) == pytest.approx(score)
    assert trajectory_iou(ARC, BENT, 7) == pytest.approx(score)


def test_missing_path_scores_zero():
    assert trajectory_iou(None, ARC, 5) == 0


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ((ARC, ARC, 0), ValueError, "radius must be finite and above 0 pixels, got 0"),
        ((None, ARC, np.nan), ValueError, "radius must be finite"),
        ((ARC, ARC, 5, 1), ValueError, "samples must be 2 or more, got 1"),
        ((ARC.xy, ARC, 5), TypeError, "estimated must be a Trajectory, got ndarray"),
        ((ARC, None, 5), TypeError, "true must be a Trajectory, got NoneType"),
    ],
)
def test_rejects_wrong_arguments(arguments, error, says):
    with pytest.raises(error, match=says):
        trajectory_iou(*arguments)


@pytest.fixture
def plate():
    return np.random.default_rng(0).uniform(0.1, 0.7, (12, 20, 3))


@pytest.fixture
def true(plate):
    """A bright square that moves to the right by 4 pixels per sub-frame."""
    stack = np.repeat(plate[None], 4, axis=0)
    for k, frame in enumerate(stack):
        frame[3:9, 4 * k : 4 * k + 5] = 0.9, 0.5, 0.2
    return stack


@pytest.fixture
def estimated(true):
    return true + np.random.default_rng(1).normal(0, 0.05, true.shape)


def skimage_ssim(estimated, true):
    span = true.max() - true.min()
    return np.mean(
        [
            structural_similarity(a, b, data_range=span, channel_axis=2)
            for a, b in zip(estimated, true, strict=True)
        ]
    )


def test_psnr_is_that_of_the_whole_stack(estimated, true, plate):
    expected = peak_signal_noise_ratio(true, estimated, data_range=1)
    assert subframe_psnr(estimated, true, plate) == pytest.approx(expected, rel=1e-12)


def test_psnr_equals_that_computed_by_hand(true, plate):
    """One sub-frame of four is off by 0.2 everywhere: a mean square of 0.01, 20 dB."""
    wrong = true.copy()
    wrong[2] += 0.2
    assert subframe_psnr(wrong, true, plate) == pytest.approx(20)


def test_ssim_is_that_of_scikit_image(estimated, true, plate):
    assert_allclose(
        subframe_ssim(estimated, true, plate), skimage_ssim(estimated, true), rtol=1e-10
    )


def test_ssim_of_the_smallest_picture_is_one_window_each(estimated, true, plate):
    small = (slice(None), slice(2, 9), slice(1, 8))
    expected = skimage_ssim(estimated[small], true[small])
    assert subframe_ssim(estimated[small], true[small], plate[small[1:]]) == pytest.approx(expected)


def test_ssim_takes_its_scale_from_the_whole_true_stack(estimated, true, plate):
    """A bright spot in one true sub-frame matters for all, a bright estimate for none but itself."""
    spot = true.copy()
    spot[0, 0, 0] = 1
    assert subframe_ssim(estimated, spot, plate) == pytest.approx(skimage_ssim(estimated, spot))
    dazzled = estimated.copy()
    dazzled[0, 0, 0] = 4
    assert subframe_ssim(dazzled, true, plate) == pytest.approx(skimage_ssim(dazzled, true))


def test_scores_of_the_truth_are_perfect(true, plate):
    assert subframe_psnr(true, true, plate) == 100
    assert subframe_ssim(true, true, plate) == pytest.approx(1, abs=1e-12)


def test_scores_are_at_most_perfect(true, plate):
    assert subframe_psnr(true + 1e-9, true, plate) == 100


@pytest.mark.parametrize("metric", BOTH)
def test_scores_do_not_depend_on_the_direction_of_time(metric, estimated, true, plate):
    score = metric(estimated, true, plate)
    assert metric(estimated[::-1], true, plate) == pytest.approx(score)
    assert metric(estimated, true[::-1], plate) == pytest.approx(score)


@pytest.mark.parametrize("metric", BOTH)
def test_other_orders_of_sub_frames_score_less(metric, true, plate):
    assert metric(true[[1, 0, 2, 3]], true, plate) < 0.95 * metric(true, true, plate)


def test_direction_is_chosen_for_the_whole_stack(true, plate):
    """The first sub-frame alone matches the last one; the others match in order."""
    wrong = true.copy()
    wrong[0] = true[3]
    moved = np.mean((true[3] - true[0]) ** 2) / 4
    assert subframe_psnr(wrong, true, plate) == pytest.approx(-10 * np.log10(moved))
    assert subframe_ssim(wrong, true, plate) == pytest.approx(skimage_ssim(wrong, true))


@pytest.mark.parametrize("metric", BOTH)
def test_missing_answer_scores_as_the_plate(metric, true, plate):
    bare = np.repeat(plate[None], len(true), axis=0)
    assert metric(None, true, plate) == metric(bare, true, plate) < metric(true, true, plate)


def test_plate_is_used_for_missing_answers_only(estimated, true, plate):
    for metric in BOTH:
        assert metric(estimated, true, plate) == metric(estimated, true, 0 * plate)
        assert metric(None, true, plate) > metric(None, true, 0 * plate)


@pytest.mark.parametrize("metric", BOTH)
def test_scores_of_rotated_pictures_are_equal(metric, estimated, true, plate):
    score = metric(estimated, true, plate)
    for axis in (0, 1):
        flipped = (np.flip(a, axis - 3) for a in (estimated, true, plate))
        assert metric(*flipped) == pytest.approx(score)
    swapped = (a[..., ::-1] for a in (estimated, true, plate))
    assert metric(*swapped) == pytest.approx(score)


def test_float32_agrees_with_float64(estimated, true, plate):
    single = [a.astype(np.float32) for a in (estimated, true, plate)]
    for metric in BOTH:
        assert metric(*single) == pytest.approx(
            metric(*(a.astype(float) for a in single)), rel=1e-12
        )


def with_nan(array):
    array = array.copy()
    array[..., 0, 0, 0] = np.nan
    return array


@pytest.mark.parametrize("metric", BOTH)
@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda e, t, p: (e[:3], t, p), ValueError, r"estimated must have the shape \(4, 12, 20, 3"),
        (lambda e, t, p: (e[0], t, p), ValueError, r"estimated must have the shape \(n, height"),
        (lambda e, t, p: (e, t[..., :2], p), ValueError, r"true must have the shape \(n, height"),
        (lambda e, t, p: (e, t, p[1:]), ValueError, r"plate must have the shape \(12, 20, 3\)"),
        (lambda e, t, p: (None, t, p[1:]), ValueError, r"plate must have the shape \(12, 20, 3\)"),
        (lambda e, t, p: (None, t, None), TypeError, "plate must be a NumPy array"),
        (lambda e, t, p: (with_nan(e), t, p), ValueError, "estimated must be finite, got 4 NaN"),
        (lambda e, t, p: (e, with_nan(t), p), ValueError, "true must be finite, got 4 NaN"),
        (lambda e, t, p: (e, t, with_nan(p)), ValueError, "plate must be finite, got 1 NaN"),
        (lambda e, t, p: (e, 255 * t, p), ValueError, "true must be coded as sRGB from 0 to 1, got"),
        (lambda e, t, p: (e, t, p - 0.5), ValueError, "plate must be coded as sRGB from 0 to 1"),
        (lambda e, t, p: (e, (255 * t).astype(np.uint8), p), TypeError, "true must hold floats"),
        (lambda e, t, p: ((255 * t).astype(np.uint8), t, p), TypeError, "estimated must hold floats"),
    ],
)  # fmt: skip
def test_rejects_wrong_subframes(metric, change, error, says, estimated, true, plate):
    with pytest.raises(error, match=says):
        metric(*change(estimated, true, plate))


def test_ssim_rejects_wrong_arguments(estimated, true, plate):
    with pytest.raises(
        ValueError, match=r"true must be 7 by 7 pixels or more, got \(4, 6, 20, 3\)"
    ):
        subframe_ssim(estimated[:, :6], true[:, :6], plate[:6])
    with pytest.raises(ValueError, match=r"true must show something, all its values are 0\.5"):
        subframe_ssim(estimated, 0 * true + 0.5, plate)
