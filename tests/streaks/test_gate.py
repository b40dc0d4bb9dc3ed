"""The gate: what moved in a frame, from code values alone."""

import numpy as np
import pytest

from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import CodedFrame, coded
from blurmatte.streaks import Gate
from blurmatte.streaks.gate import count_changes, joined, sum_pairs

SIZE = (129, 95)  # odd: the last cells are extended


def scene(rng, codes=90.0):
    """Code values of a gray ramp, and a function that adds noise of two codes."""
    plate = codes + np.linspace(0, 60, SIZE[0])[None, :] * np.ones((SIZE[1], 1))
    return plate, lambda: np.rint(plate + rng.normal(0, 2, plate.shape))


def framed(number, luma, half=True):
    """A frame with gray chroma, of half the size or of the same."""
    h, w = luma.shape
    chroma = np.full((-(-h // 2), -(-w // 2)) if half else (h, w), 128, np.uint8)
    planes = luma.astype(np.uint8), chroma, chroma.copy()
    return CodedFrame(number, None, planes, (16.0, 128.0, 128.0), 1.0, lambda box, every: None)


def gate_of(plate, noisy, half=True, **limits):
    samples = [framed(k, noisy(), half) for k in range(12)]
    return Gate.of(framed(-1, plate, half), samples, **limits)


@pytest.mark.parametrize("half", [True, False])
def test_noise_alone_is_no_change(half):
    plate, noisy = scene(np.random.default_rng(1))
    gate = gate_of(plate, noisy, half)
    assert not any(gate.changes(framed(k, noisy(), half)) for k in range(20))


def test_strips_of_the_frames_have_the_tables_of_the_whole():
    # exact
    tables = []
    for rows in (256, 8):
        plate, noisy = scene(np.random.default_rng(1))
        gate = gate_of(plate, noisy, strip=rows)
        tables.append([*gate.cell_reach, *gate.block_reach])
    for whole, strips in zip(*tables, strict=True):
        assert np.array_equal(whole, strips)


@pytest.mark.parametrize(("contrast", "width"), [(60, 6), (5, 40)])
def test_small_sharp_and_broad_faint_changes_are_found(contrast, width):
    plate, noisy = scene(np.random.default_rng(2))
    gate, luma = gate_of(plate, noisy), noisy()
    luma[40 : 40 + width, 60 : 60 + width] += contrast
    (box,) = gate.changes(framed(0, luma))
    x0, y0, x1, y1 = box
    assert (x0, y0) <= (40, 20)
    assert min(x1 - 60 - width, y1 - 40 - min(width, 20)) >= 20


def test_change_of_chroma_alone_is_found():
    plate, noisy = scene(np.random.default_rng(3))
    gate, frame = gate_of(plate, noisy), framed(0, noisy())
    frame.planes[2][20:26, 30:36] += 12
    (box,) = gate.changes(frame)
    assert max(box[:2]) < 40 < 60 < min(box[2:])


def test_change_of_lamp_is_no_motion():
    plate, noisy = scene(np.random.default_rng(4))
    assert gate_of(plate, noisy).changes(framed(7, 16 + 1.08 * (noisy() - 16))) == ()


def test_object_in_half_of_the_samples_does_not_blind_the_gate():
    plate, noisy = scene(np.random.default_rng(5))

    def with_object(k):
        luma = noisy()
        luma[30:50, 40:60] += 60 * (k % 2 == 0)
        return framed(k, luma)

    gate = Gate.of(framed(-1, plate), [with_object(k) for k in range(1, 12)])
    assert len(gate.changes(with_object(0))) == 1


def test_few_samples_share_one_noise():
    rng = np.random.default_rng(6)
    plate, noisy = scene(rng)
    moved = noisy()
    moved[30:50, 40:60] += 60
    gate = Gate.of(framed(-1, plate), [framed(0, moved)])
    assert len(gate.changes(framed(0, moved))) == 1
    assert gate.changes(framed(0, noisy())) == ()


def test_pictures_of_light_need_no_codes():
    rng = np.random.default_rng(7)
    plate = np.full((64, 48, 3), 0.3)
    images = [LinearImage(plate + rng.normal(0, 0.01, plate.shape)) for _ in range(10)]
    gate = Gate.of(coded(-1, LinearImage(plate)), [coded(k, one) for k, one in enumerate(images)])
    image = LinearImage(images[0].rgb.copy())
    assert gate.changes(coded(0, image)) == ()
    image.rgb[20:32, 20:32] += 0.1
    assert gate.changes(coded(0, image)) == ((0, 0, 48, 64),)


def test_sums_over_pairs_agree_with_numpy():
    plane = np.random.default_rng(8).integers(0, 256, (10, 14)).astype(np.uint8)
    out = np.empty((5, 7), np.float32)
    sum_pairs(plane, out)
    assert np.array_equal(out, plane.reshape(5, 2, 7, 2).sum(axis=(1, 3)))


@pytest.mark.parametrize("n", [1, 2])
def test_counts_and_sums_agree_with_numpy(n):
    rng = np.random.default_rng(9)
    plane = rng.integers(0, 9, (8 * n, 12 * n)).astype(np.uint8)
    expected = rng.normal(8, 3, (8, 12)).astype(np.float32)
    reach = np.full((8, 12), 5.2, np.float32)
    counts, sums = np.zeros((2, 3), np.int32), np.empty((2, 3), np.float32)
    count_changes(plane, np.float32(4), np.float32(1.5), expected, reach, 4, counts, sums)
    cells = plane.reshape(8, n, 12, n).sum(axis=(1, 3)).astype(np.float32)
    d = cells - 4 - np.float32(1.5) * expected
    assert np.allclose(sums, d.reshape(2, 4, 3, 4).sum(axis=(1, 3)), atol=1e-3)
    assert np.array_equal(counts, (np.abs(d) > 5.2).reshape(2, 4, 3, 4).sum(axis=(1, 3)))


def test_hidden_places_do_not_move():
    """A clock that runs is no motion, an object next to it is."""
    plate, noisy = scene(np.random.default_rng(11))
    hidden = np.zeros(plate.shape, bool)
    hidden[10:30, 10:50] = True
    samples = [framed(k, noisy()) for k in range(12)]
    gate, frame = Gate.of(framed(-1, plate), samples, hidden), framed(0, noisy())
    frame.planes[0][10:30, 10:50] = 20
    assert gate.changes(frame) == ()
    frame.planes[0][60:70, 60:70] = 20
    assert len(gate.changes(frame)) == 1


def test_overlapping_boxes_are_joined_until_none_overlap():
    boxes = [(0, 0, 10, 10), (8, 8, 20, 20), (19, 0, 30, 9), (40, 40, 50, 50)]
    assert joined(boxes) == [(0, 0, 30, 20), (40, 40, 50, 50)]


def test_frame_of_another_size_is_refused():
    plate, noisy = scene(np.random.default_rng(10))
    with pytest.raises(ValueError, match="129x95"):
        gate_of(plate, noisy).changes(framed(0, np.zeros((48, 64))))
