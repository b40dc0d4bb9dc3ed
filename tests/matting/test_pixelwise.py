"""Pixelwise: exact without noise, calibrated errors, and results that do not depend on the
computation.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize_scalar

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel
from blurmatte.matting import PixelMaps, Pixelwise, Quality
from blurmatte.matting import maps as maps_module
from blurmatte.matting import pixelwise as kernel
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, NoiseModel
from blurmatte.rendering import Camera
from blurmatte.rendering.processing import encode_codes

NONE = NoiseModel()
SENSOR = NoiseModel(
    gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.001, 0.004), relative_std=(0.003, 0.002, 0.006)
)
PLATE = NoiseModel(gain=(5e-5, 1e-4, 1e-4), read_std=(0.001, 0.002, 0.001))
OF_IMAGE, OF_PLATE = Camera(SENSOR, bits=None), Camera(PLATE, bits=None)
COUNT = 60


def solve(image, plate, model, **options) -> PixelMaps:
    return Pixelwise()(image.rgb, plate.rgb, model, image.noise, plate.noise, **options)


def distinguishable(rendering, least=1e-2):
    """Where the exact plate is clearly outside the color model."""
    plate = rendering.plate.rgb
    across = np.linalg.norm(plate @ rendering.model.normals, axis=-1)
    return across > least * np.linalg.norm(plate, axis=-1)


def errors(image, plate, rendering):
    """(estimate − truth) / std of alpha and light, in and outside the streak, with outliers. Only
    where the exact plate is clearly outside the model: elsewhere alpha is not linear in the plate's
    noise and has a bias of about alpha_std², and selection must not depend on noise.
    """
    exact = (rendering.plate.with_noise(p.noise) for p in (image, plate))
    known = (solve(*exact, rendering.model).alpha_std < 0.1) & image.valid & plate.valid
    maps, layer = solve(image, plate, rendering.model), rendering.layer
    for place in (known & (layer.alpha > 0.01), known & (layer.alpha == 0)):
        yield ((maps.alpha - layer.alpha) / maps.alpha_std)[place]
        yield ((maps.premultiplied - layer.premultiplied) / maps.premultiplied_std)[place].ravel()


def assert_honest(trials):
    """Each kind of error has mean 0 and standard deviation 1 over all trials."""
    for z in map(np.concatenate, zip(*trials, strict=True)):
        assert len(z) > 5000
        assert abs(z.mean()) < 0.1
        assert 0.9 < z.std() < 1.1


# Exact


@pytest.mark.parametrize("noise", [NONE, SENSOR], ids=["none", "declared"])
def test_exact_for_any_declared_noise(rendering, noise):
    """The weights only choose between consistent equations."""
    declared = (p.with_noise(noise) for p in (rendering.image, rendering.plate))
    maps = solve(*declared, rendering.model)
    clear = distinguishable(rendering)
    assert clear.mean() > 0.95
    assert_allclose(maps.alpha[clear], rendering.layer.alpha[clear], rtol=0, atol=1e-10)
    assert_allclose(
        maps.premultiplied[clear], rendering.layer.premultiplied[clear], rtol=0, atol=1e-9
    )
    assert not (maps.quality[clear] & ~np.uint8(Quality.PLATE_IN_MODEL)).any()


def test_layer_over_plate_is_the_image(rendering):
    """The residual is noise; rank 2 leaves no residual."""
    rng = np.random.default_rng(0)
    image = OF_IMAGE.photograph(rendering.image.rgb, rng)
    maps = solve(image, rendering.plate.with_noise(NONE), rendering.model)
    back = maps.premultiplied + (1 - maps.alpha[..., None]) * rendering.plate.rgb
    rest = ((back - image.rgb) / np.sqrt(image.variance))[distinguishable(rendering)]
    if rendering.model.rank == 2:
        assert np.abs(rest).max() < 1e-6
    else:
        assert_allclose(np.sum(rest**2, axis=-1).mean(), 1, atol=0.05)  # one equation is left over


# Honest


def test_errors_with_known_noise_are_calibrated(rendering):
    rng, trials = np.random.default_rng(1), []
    for _ in range(6):
        image = OF_IMAGE.photograph(rendering.image.rgb, rng)
        plate = OF_PLATE.photograph(rendering.plate.rgb, rng)
        trials.append(errors(image, plate, rendering))
    assert_honest(trials)


@pytest.mark.diagonal
@pytest.mark.parametrize("plate_part", [0, 0.5, 1])
@pytest.mark.parametrize("code_std", [1 / 255, 2 / 255], ids=["1/255", "2/255"])
def test_errors_in_8_bits_with_measured_noise_are_calibrated(rendering, code_std, plate_part):
    rng, trials = np.random.default_rng(2), []
    for _ in range(4):
        image = Camera(code_std=code_std).photograph(rendering.image.rgb, rng)
        plate = Camera(code_std=code_std * plate_part).photograph(rendering.plate.rgb, rng)
        trials.append(errors(*with_noise(image, plate), rendering))
    assert_honest(trials)


def test_misfit_flags_are_rare_for_the_true_model(rendering):
    rng = np.random.default_rng(3)
    image = OF_IMAGE.photograph(rendering.image.rgb, rng)
    plate = OF_PLATE.photograph(rendering.plate.rgb, rng)
    quality = solve(image, plate, rendering.model).quality
    assert np.mean((quality & Quality.MISFIT) != 0) < 5e-4


def test_misfit_flags_most_pixels_of_a_wrong_model(paint):
    image = OF_IMAGE.photograph(paint.image.rgb, 3)
    wrong = solve(image, paint.plate.with_noise(NONE), ColorModel.from_hex("#2060ff"))
    misfit = (wrong.quality & Quality.MISFIT) != 0
    assert np.mean(misfit[paint.layer.alpha > 0.1]) > 0.3
    assert np.mean(misfit[paint.layer.alpha == 0]) < 5e-4


# Flags


def test_plate_in_the_model_has_an_infinite_error(rendering):
    """A plate of the object's own colors."""
    color = rendering.model.basis @ np.full(rendering.model.rank, 0.3)
    plate = LinearImage(np.tile(color, (4, 4, 1)), noise=SENSOR)
    maps = solve(plate, plate, rendering.model)
    assert np.all(maps.alpha_std > 100)
    assert np.all(maps.quality & Quality.PLATE_IN_MODEL)


def test_black_plate_leaves_alpha_unknown(rendering):
    black = LinearImage(np.zeros((4, 4, 3)), noise=NONE)
    maps = solve(black, black, rendering.model)
    assert np.isfinite(maps.alpha).all()
    assert np.all(maps.quality & Quality.PLATE_IN_MODEL)


@pytest.mark.parametrize(
    ("alpha", "flagged"), [(-0.05, True), (0.0, False), (1.0, False), (1.05, True)]
)
def test_alpha_beyond_the_range_by_three_sigma_is_flagged(alpha, flagged):
    model = ColorModel(np.array([[1.0], [0], [0]]))
    plate = LinearImage(np.full((1, 1, 3), 0.5), noise=NoiseModel())
    image = LinearImage((1 - alpha) * plate.rgb, noise=NoiseModel(read_std=0.01))
    maps = solve(image, plate, model)
    assert_allclose(maps.alpha_std, 0.01 / np.sqrt(0.5), rtol=1e-6)  # α = ±0.05 is 3.5 sigma
    assert bool(maps.quality[0, 0] & Quality.OUT_OF_RANGE) is flagged


def test_max_alpha_std_limits_known_pixels():
    model = ColorModel(np.array([[1.0], [0], [0]]))
    plate = LinearImage(np.full((1, 1, 3), 0.5), noise=NoiseModel())
    image = LinearImage(plate.rgb, noise=NoiseModel(read_std=0.01))
    for limit, unknown in ((0.02, False), (0.01, True)):
        solver = Pixelwise(max_alpha_std=limit)
        maps = solver(image.rgb, plate.rgb, model, image.noise, plate.noise)
        assert bool(maps.quality[0, 0] & Quality.PLATE_IN_MODEL) is unknown


def test_saturated_pixels_are_unknown(paint):
    flags = np.zeros(paint.image.valid.shape, np.uint8)
    flags[:5] = Quality.SATURATED
    flags[5:9] = Quality.OUTSIDE
    maps = solve(
        paint.image.with_noise(SENSOR), paint.plate.with_noise(PLATE), paint.model, flags=flags
    )
    assert np.all(np.isinf(maps.alpha_std[:5]))
    assert np.isfinite(maps.alpha_std[5:]).all()
    assert np.all(maps.quality[:5] & Quality.SATURATED)
    assert np.all(maps.quality[5:9] & Quality.OUTSIDE)
    assert not flags[9:].any()  # what was handed in is not written to


# Invariance to the computation


@pytest.fixture(scope="module")
def noisy(paints):
    rng = np.random.default_rng(5)
    image = OF_IMAGE.photograph(paints.image.rgb.astype(np.float32), rng)
    return (
        image,
        OF_PLATE.photograph(paints.plate.rgb.astype(np.float32), rng),
        paints.model,
    )


def assert_same(a: PixelMaps, b: PixelMaps, tolerance):
    """Equal within a fraction of a pixel's own error, where alpha is known to better than 1."""
    well = a.alpha_std < 1
    a, b = (PixelMaps(*(m[well].astype(float) for m in maps)) for maps in (a, b))
    assert np.mean(well) > 0.9
    assert_allclose((b.alpha - a.alpha) / a.alpha_std, 0, atol=tolerance)
    assert_allclose((b.premultiplied - a.premultiplied) / a.premultiplied_std, 0, atol=tolerance)
    assert_allclose(b.alpha_std, a.alpha_std, rtol=tolerance)
    assert_allclose(b.premultiplied_std, a.premultiplied_std, rtol=tolerance)
    assert np.mean(a.quality != b.quality) <= tolerance


def test_float32_agrees_with_float64(rendering):
    rng = np.random.default_rng(6)
    image = OF_IMAGE.photograph(rendering.image.rgb, rng)
    plate = OF_PLATE.photograph(rendering.plate.rgb, rng)
    double = solve(image, plate, rendering.model)
    single = solve(*(LinearImage(p.rgb.astype(np.float32), p.noise) for p in (image, plate)),
                   rendering.model)  # fmt: skip
    assert single.alpha.dtype == np.float32
    assert_same(double, single, 2e-3)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("transfer", [SRGB, LINEAR], ids=lambda transfer: transfer.name)
def test_codes_give_the_result_of_their_light(noisy, bits, transfer):
    image, plate, model = noisy
    codes = [encode_codes(p.rgb, bits, transfer) for p in (image, plate)]
    table = transfer.table(2**bits).astype(np.float32)
    by_light = Pixelwise()(*(table[c] for c in codes), model, SENSOR, PLATE)
    by_codes = Pixelwise()(*codes, model, SENSOR, PLATE, tables=(table, table))
    for a, b in zip(by_light, by_codes, strict=True):
        assert_array_equal(a, b)


def test_image_and_plate_may_have_different_codes(noisy):
    image, plate, model = noisy
    tables = SRGB.table(256).astype(np.float32), LINEAR.table(65536).astype(np.float32)
    codes = encode_codes(image.rgb, 8, SRGB), encode_codes(plate.rgb, 16, LINEAR)
    mixed = Pixelwise()(*codes, model, SENSOR, PLATE, tables=tables)
    light = (table[c] for table, c in zip(tables, codes, strict=True))
    assert_same(Pixelwise()(*light, model, SENSOR, PLATE), mixed, 1e-5)


def test_variances_give_the_result_of_their_noise_model(noisy):
    image, plate, model = noisy
    by_model = solve(image, plate, model)
    by_pixel = Pixelwise()(image.rgb, plate.rgb, model, image.variance, plate.variance)
    mixed = Pixelwise()(image.rgb, plate.rgb, model, SENSOR, plate.variance)
    assert_same(by_model, by_pixel, 1e-3)
    assert_same(by_pixel, mixed, 1e-3)


@pytest.mark.parametrize("strips", [1, 2, 7, 128])
def test_result_does_not_depend_on_strips(noisy, strips, monkeypatch):
    whole = solve(*noisy)
    rows = -(-128 // strips)
    cut = [slice(a, min(a + rows, 128)) for a in range(0, 128, rows)]
    monkeypatch.setattr(maps_module, "_strips", lambda height: cut)
    monkeypatch.setattr(maps_module, "cpu_count", lambda: 3)
    for a, b in zip(whole, solve(*noisy), strict=True):
        assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("height", [1, 5, 16, 17, 1000])
def test_strips_cover_every_row_once(height):
    rows = np.concatenate([np.arange(height)[strip] for strip in maps_module._strips(height)])
    assert_array_equal(rows, np.arange(height))


def test_out_is_written_to_and_reused(noisy):
    fresh = solve(*noisy)
    out = PixelMaps.empty(*fresh.alpha.shape)
    for m in out:
        m.fill(77)
    again = solve(*noisy, out=out)
    assert again is out
    for a, b in zip(fresh, out, strict=True):
        assert_array_equal(a, b)


def test_out_determines_the_precision(noisy):
    out = PixelMaps.empty(*noisy[0].valid.shape, np.float64)
    assert solve(*noisy, out=out).alpha.dtype == np.float64
    assert_same(out, solve(*noisy), 0.02)


def test_pictures_need_not_be_contiguous(noisy):
    image, plate, model = noisy
    whole = solve(image, plate, model)
    C, B = (np.asfortranarray(p.rgb)[:, ::-1] for p in (image, plate))
    flipped = Pixelwise()(C, B, model, SENSOR, PLATE)
    for a, b in zip(whole, flipped, strict=True):
        assert_array_equal(a[:, ::-1], b)


def test_alpha_does_not_depend_on_exposure(noisy):
    image, plate, model = noisy
    double = [(p.rgb.astype(float), p.noise.coefficients) for p in (image, plate)]
    dim, bright = (
        Pixelwise()(*(k * light for light, _ in double), model,
                    *(NoiseModel.from_coefficients(c * [k**2, k, 1]) for _, c in double))
        for k in (1, 8)
    )  # fmt: skip
    as_dim = bright._replace(
        premultiplied=bright.premultiplied / 8, premultiplied_std=bright.premultiplied_std / 8
    )
    assert_same(dim, as_dim, 1e-4)


def test_swapped_channels_swap_the_light(noisy):
    image, plate, model = noisy
    order = [2, 0, 1]

    def swapped(noise):
        return NoiseModel.from_coefficients(noise.coefficients[order])

    maps = Pixelwise()(image.rgb.astype(float), plate.rgb.astype(float), model, SENSOR, PLATE)
    turned = Pixelwise()(
        image.rgb[..., order].astype(float), plate.rgb[..., order].astype(float),
        ColorModel(model.basis[order]), swapped(SENSOR), swapped(PLATE),
    )  # fmt: skip
    as_turned = maps._replace(
        premultiplied=maps.premultiplied[..., order],
        premultiplied_std=maps.premultiplied_std[..., order],
    )
    assert_same(as_turned, turned, 1e-6)


# The door


@pytest.mark.parametrize("limit", [0, -1, np.nan])
def test_rejects_limits_not_above_zero(limit):
    with pytest.raises(ValueError, match="max_alpha_std must be positive"):
        Pixelwise(max_alpha_std=limit)


def test_rejects_out_of_another_size(noisy):
    with pytest.raises(
        ValueError, match=r"out must have the shape \(128, 192, 3\), got \(4, 4, 3\)"
    ):
        solve(*noisy, out=PixelMaps.empty(4, 4))


def test_rejects_codes_with_variance_per_pixel(noisy):
    codes = np.zeros((2, 2, 3), np.uint8)
    table = SRGB.table(256)
    with pytest.raises(TypeError, match="code values need a NoiseModel"):
        Pixelwise()(codes, codes, noisy[2], np.ones((2, 2, 3)), SENSOR, tables=(table, table))


def test_maps_of_a_box_are_written_into_the_box():
    """exact"""
    maps, box = PixelMaps.zeros(6, 8), (2, 1, 5, 4)
    part = PixelMaps(*(np.full_like(m, 3) for m in maps.within(box)))
    maps.write(box, part)
    for values, own, copied in zip(maps, part, maps.within(box).copied, strict=True):
        assert_array_equal(values[1:4, 2:5], own)
        assert values.sum() == own.sum()
        assert_array_equal(copied, own)
        assert not np.shares_memory(copied, values)


@pytest.fixture(params=[1, 2], ids=["line", "plane"])
def pixels(request):
    """Pixels that fit a model of colors badly: (model, C, B, σ_C², σ_B²), all (1, n, 3)."""
    rng = np.random.default_rng(request.param)
    basis = np.linalg.qr(rng.uniform(0.1, 1, (3, request.param)))[0]
    model = ColorModel(basis * np.sign(basis.sum(axis=0)))
    B = rng.uniform(0.2, 1, (1, COUNT, 3))
    P = rng.uniform(0.1, 0.4, (1, COUNT, request.param)) @ model.basis.T
    C = P + rng.uniform(0.2, 0.8, (1, COUNT, 1)) * B + rng.normal(0, 0.02, B.shape)
    return model, C, B, *(rng.uniform(0.5, 2, (2, *B.shape)) * 4e-4)


def nearest_color(C, model, variance):
    """The model's color P nearest to a color C, by weighted least squares; and its distance²."""
    weight = 1 / np.sqrt(variance)
    mixture = np.linalg.lstsq(model.basis * weight[:, None], C * weight)[0]
    P = model.basis @ mixture
    return P, float(np.sum(((C - P) * weight) ** 2))


def brute_force(C, B, vC, vB, model):
    """Search for the α at which C − (1 − α) B is nearest to the model."""
    normals = model.normals
    plain = float(np.sum((B @ normals) * ((B - C) @ normals)) / np.sum((B @ normals) ** 2))
    variance = vC + (1 - np.clip(plain, 0, 1)) ** 2 * vB

    def distance2(alpha):
        return nearest_color(C - (1 - alpha) * B, model, variance)[1]

    alpha = minimize_scalar(distance2, bounds=(-3, 4), method="bounded", options={"xatol": 1e-9}).x
    step = 0.1  # the distance is a parabola: its curvature is twice the information
    curvature = (distance2(alpha + step) + distance2(alpha - step) - 2 * distance2(alpha)) / step**2
    P = nearest_color(C - (1 - alpha) * B, model, variance)[0]
    return alpha, (2 / curvature) ** 0.5, distance2(alpha), P, variance


def closed_form(pixels) -> PixelMaps:
    model, C, B, vC, vB = pixels
    return Pixelwise()(C, B, model, vC, vB)


def test_alpha_std_and_light_equal_those_of_a_search(pixels):
    model, C, B, vC, vB = pixels
    maps = closed_form(pixels)
    for i in range(COUNT):
        alpha, std, _, P, _ = brute_force(C[0, i], B[0, i], vC[0, i], vB[0, i], model)
        assert_allclose(maps.alpha[0, i], alpha, atol=1e-5)
        assert_allclose(maps.alpha_std[0, i], std, rtol=1e-4)
        assert_allclose(maps.premultiplied[0, i], P, atol=1e-5)


def test_light_lies_in_the_model(pixels):
    maps = closed_form(pixels)
    assert_allclose(maps.premultiplied @ pixels[0].normals, 0, atol=1e-14)


def test_error_of_the_light_is_propagated_from_its_derivatives(pixels):
    """Oracle: finite differences of P by each channel of C."""
    model, C, B, vC, vB = pixels
    still = vB * 0  # then the weights do not move with C
    maps, h = Pixelwise()(C, B, model, vC, still), 1e-6
    variance = np.zeros_like(C)
    for c in range(3):
        moved = C + h * np.eye(3)[c]
        slope = (Pixelwise()(moved, B, model, vC, still).premultiplied - maps.premultiplied) / h
        variance += slope**2 * vC[..., c : c + 1]
    assert_allclose(maps.premultiplied_std, np.sqrt(variance), rtol=1e-4)


def test_misfit_is_flagged_beyond_four_sigma(pixels):
    """A pixel off the model by χ = 3.9 fits, by 4.1 it does not; every pixel fits rank 2."""
    model, C, B, *_ = pixels
    flags = {}
    for sigmas in (3.9, 4.1):
        alpha = 0.5
        P = 0.3 * model.basis.sum(axis=1)
        exact = P + (1 - alpha) * B
        if model.rank == 1:  # the direction in which α changes nothing, in units of its noise
            away = np.cross(np.broadcast_to(model.pole, B.shape), B)
            away /= np.linalg.norm(away, axis=-1, keepdims=True)
        else:
            away = np.broadcast_to(model.pole, B.shape)
        quality = exact + sigmas * 0.01 * away
        even = np.full_like(C, 0.01**2)
        flags[sigmas] = Pixelwise()(quality, B, model, even, 0 * even).quality & Quality.MISFIT
    assert not flags[3.9].any()
    assert bool(flags[4.1].all()) == (model.rank == 1)


def test_variance_of_light_is_the_noise_model():
    noise = NoiseModel(gain=(1e-3, 2e-3, 3e-3), read_std=0.01, relative_std=(0.1, 0.2, 0.3))
    coefficients = tuple(noise.coefficients.ravel())
    for light in (-0.5, 0.0, 0.2, 1.5):
        seen = [kernel.variance_at.py_func(light, coefficients, c) for c in range(3)]
        assert_allclose(seen, noise.variance(np.full(3, light)), rtol=1e-6)


def test_flags_of_the_kernel_are_bytes_with_the_bits_of_quality():
    flags = kernel._PLATE_IN_MODEL, kernel._OUT_OF_RANGE, kernel._MISFIT, kernel._UNKNOWN
    assert [flag.dtype for flag in flags] == [np.uint8] * 4
    assert [int(flag) for flag in flags] == [2, 4, 8, Quality.SATURATED | Quality.OCCLUDED]
