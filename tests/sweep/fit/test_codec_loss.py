from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.scenes import on_line
from tests.sweep.scenes import (
    BOUNDS,
    CAMERA,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    JPEG,
    ONE_PAINT,
    RADIUS,
    along,
    alpha_error,
    disc_at,
    observed,
    photographed,
    rendered,
    within,
)

from blurmatte.radiometry import REC709, SRGB, CodingError, LinearImage
from blurmatte.radiometry.compression import CodingErrors, FrameCoding, lost_change
from blurmatte.radiometry.image import Meta
from blurmatte.radiometry.transfer import LUMA_WEIGHTS_709, ycbcr_matrix
from blurmatte.rendering import Ball, Camera
from blurmatte.rendering.plates import textured_plate
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.diagnostics import sweep_of
from blurmatte.sweep.discs import fit_disc
from blurmatte.sweep.fit.codec_loss import (
    candidate_before_file,
    chroma_blur_std,
    corrected_for_file,
    correction,
)
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import Candidate
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import MAX_FILE_BLUR_PX, Silhouette

STEP, NOISE = 8 / 255, 1 / 255  # code values
COLOR = np.array([0.6, 0.3, 0.1])
SCENE = FLAT_BEFORE_TILES[LINE]


def coded(seed, fraction):
    """Image, plate and streak of a fast ball, a fraction of whose loss by the quantizer is real."""
    rng = np.random.default_rng(seed)
    size, radius = (176, 96), rng.uniform(9, 14)
    plate = 0.6 * textured_plate(size, rng)
    scene = on_line(
        plate, (40.3, 44), (40.3 + rng.uniform(70, 90), 50), Ball(radius, COLOR, ambient=1.0)
    )
    codes, before = REC709.encode(scene.image.rgb), REC709.encode(plate)
    matrix = ycbcr_matrix(LUMA_WEIGHTS_709)
    planes = (codes - before) @ matrix.T
    lost = np.stack([lost_change(planes[..., c], STEP) for c in range(3)], axis=-1)
    codes = codes - fraction * lost @ np.linalg.inv(matrix).T
    codes = np.clip(codes + NOISE * rng.standard_normal(codes.shape), 0, 1)
    variance = ((NOISE * REC709.slope(scene.image.rgb)) ** 2).astype(np.float32)
    none = CodingError(np.zeros((1, 1, 3), np.float32), size, REC709)
    meta = Meta(transfer=REC709, coding=FrameCoding(lambda: CodingErrors(none, none, STEP)))
    image = LinearImage(REC709.decode(codes).astype(np.float32), variance, meta=meta)
    known = LinearImage(plate.astype(np.float32), np.full_like(variance, 1e-9))
    return image, known, Streak(scene.layer.alpha > 0.01), radius


def radius_of(seed, fraction, with_coding=True):
    """Error of the radius over its standard deviation, and in pixels."""
    image, plate, streak, radius = coded(seed, fraction)
    if not with_coding:
        image = replace(image, meta=replace(image.meta, coding=None))
    sweep = fit_disc(image, plate, streak, Ball(1.0, COLOR, ambient=1.0).model)
    return (sweep.radius - radius) / sweep.radius_std, sweep.radius - radius


@pytest.mark.parametrize(
    ("fraction", "seeds", "least", "most"), [(0.0, 24, 0.22, 0.34), (0.5, 3, 1.4, 2.3)]
)
def test_error_of_the_radius_is_conservative_if_no_rim_is_lost_and_half_as_large_as_it_should_be_else(
    fraction, seeds, least, most
):
    """honest: a fit that has adapted to the loss of half of it finds a fifth to a third."""
    z = [radius_of(seed, fraction)[0] for seed in range(seeds)]
    assert least < np.sqrt(np.mean(np.square(z))) < most


def test_correction_for_lost_rims_makes_a_disc_larger_and_less_certain():
    # invariant
    (z, off), (z_of_loss, off_of_loss) = (radius_of(2, 1.0, coding) for coding in (True, False))
    assert z_of_loss < 3 * z < 0
    assert off_of_loss < off < 0


@cache
def fitted(scene=SCENE, seed=0, camera=JPEG):
    """The best disc in the light as decoded from the file, near the truth."""
    observation = observed(scene, seed, camera, ONE_PAINT)
    observation = observation.raised(observation.correlated_noise())
    return minimize(disc_at(observation), BOUNDS)


def test_blur_is_that_of_the_compression_metadata():
    state = fitted()
    assert chroma_blur_std(state) == state.observation.compression.spread > 0


@pytest.mark.parametrize(("softness", "blur"), [(0.8, 0.8), (5.0, MAX_FILE_BLUR_PX)])
def test_the_blur_of_an_unknown_file_is_that_of_the_rim(softness, blur):
    """At most the blur of usual files."""
    state = fitted(camera=CAMERA)
    soft = state.of_kind(Silhouette(1, soft=True))
    soft = soft.moved(soft.path, np.array([RADIUS, softness]))
    assert chroma_blur_std(soft) == blur


def test_corrected_light_is_nearer_to_uncompressed_light():
    """honest: across the object's color."""
    state, truth = fitted(), rendered(SCENE)
    before = correction(state.observation, SRGB, chroma_blur_std(state))(state)
    across = np.linalg.svd(GREEN[:, None])[0][:, 1:]
    rim = within(state.observation, truth.layer.alpha) > 0
    true = within(state.observation, truth.image.rgb)
    off = [((x - true)[rim] @ across) for x in (state.observation.C, before.C)]
    first, second = (np.sqrt(np.mean(x**2)) for x in off)
    assert second < first
    assert before.color is state.observation.color


@pytest.mark.parametrize("soft", [False, True])
def test_the_corrected_sweep_is_a_fixed_point(soft):
    """oracle: many rounds agree within a fraction of the standard deviation."""
    observed_light = fitted().observation
    start = fitted().of_kind(Silhouette(1, soft=soft))
    if soft:
        start = minimize(start.moved(start.path, np.array([RADIUS, 1.0])), BOUNDS)
    state = slow = corrected_for_file(start, SRGB)
    std = np.sqrt(np.diag(np.linalg.inv(state.information()[0])))
    for _ in range(12):
        before = correction(observed_light, SRGB, chroma_blur_std(slow))(slow)
        slow = minimize(slow.relit(before), BOUNDS)
    moved = np.concatenate([slow.path - state.path, slow.shape - state.shape])
    assert np.abs(moved / std).max() < 0.6


def test_blur_of_the_rim_by_subsampled_chroma_is_removed():
    """honest: the first prediction has the rim that the file blurred."""
    camera = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0")
    blurred = Silhouette(1, soft=True)
    for seed in range(3):
        start = fitted.__wrapped__(FLAT[LINE], seed, camera).of_kind(blurred)
        start = minimize(start.moved(start.path, np.array([RADIUS, 1.0])), BOUNDS)
        state = corrected_for_file(start, SRGB)
        assert blurred.softness(state.shape) < 0.4 * blurred.softness(start.shape)


@pytest.mark.parametrize("scene", [FLAT[LINE], SCENE], ids=["wall", "tiles"])
def test_a_candidate_from_a_jpeg_has_the_right_alpha(scene):
    """honest"""
    candidate = candidate_before_file(Candidate(fitted(scene)), SRGB)
    assert candidate.chroma_blur > 0
    true = within(candidate.state.observation, rendered(scene).layer.alpha)
    assert alpha_error(candidate.state.swept.alpha, true) < 0.015
    assert candidate.parameters == candidate.state.size


def test_what_is_known_of_a_candidate_besides_its_light_is_kept():
    """invariant"""
    known = Candidate(fitted(SCENE), opacity_std=0.1, even_opacity_std=0.2, unresolved=3.0)
    corrected = candidate_before_file(known, SRGB)
    assert corrected.state is not known.state
    assert (corrected.opacity_std, corrected.even_opacity_std) == (0.1, 0.2)
    assert corrected.unresolved == 3


def test_candidates_without_chroma_subsampling_are_unchanged():
    """invariant"""
    state = fitted(camera=CAMERA)
    candidate = candidate_before_file(Candidate(state), SRGB)
    assert candidate.state is state
    assert candidate.chroma_blur == 0


@pytest.mark.parametrize("quality", [90, 95])
@pytest.mark.parametrize(
    "draws", [12, pytest.param(24, marks=pytest.mark.battery)], ids=["few", "many"]
)
def test_errors_from_jpegs_are_honest(quality, draws):
    """honest: from the truth, draws of noise, path and radius."""
    camera, z = Camera(code_std=1.5 / 255, jpeg_quality=quality, chroma="4:2:0"), []
    for seed in range(draws):
        state = fitted.__wrapped__(SCENE, seed, camera)
        candidate = candidate_before_file(Candidate(state), SRGB)
        sweep = sweep_of(candidate, photographed(SCENE, seed, camera)[0])
        off = np.concatenate([sweep.path, sweep.shape[:1]]) - [
            *along(LINE).xy[[0, -1]].ravel(),
            RADIUS,
        ]
        z.append(off / np.sqrt(np.diag(sweep.covariance)[: len(off)]))
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
