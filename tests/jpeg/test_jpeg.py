"""Coefficients are read and written losslessly; Pillow, OpenCV and OpenImageIO are the oracles."""

import heapq
import io
import itertools
import struct
from dataclasses import replace

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from scipy.fft import idctn

from blurmatte.jpeg.coding import huffman_codes, jpeg_bytes, read_jpeg, replace_blocks, table_bytes
from blurmatte.jpeg.structure import ZIGZAG, Component, JpegError


def scene(width, height, seed=0):
    """Smooth colors, an edge and noise: every kind of block."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    smooth = np.stack([90 + 60 * np.sin(x / 9), 120 + 50 * np.cos(y / 7), 2.0 * x + y], axis=-1)
    smooth[height // 2 :, width // 3 :] = (240, 30, 20)
    return np.clip(smooth + rng.normal(0, 6, smooth.shape), 0, 255).astype(np.uint8)


def compressed(codes, **options):
    file = io.BytesIO()
    picture = Image.fromarray(codes)
    if options.pop("gray", False):
        picture = picture.convert("L")
    picture.save(file, "JPEG", **options)
    return file.getvalue()


def by_pillow(data):
    return np.asarray(Image.open(io.BytesIO(data)))


def by_opencv(data):
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(np.frombuffer(data, np.uint8), flags)


def with_byte(data, marker, offset, value):
    """The file with one byte of a segment changed; `offset` is from its marker."""
    at = data.index(bytes([0xFF, marker])) + offset
    return data[:at] + bytes([value]) + data[at + 1 :]


@pytest.mark.diagonal
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("kind", [{"gray": True}, *({"subsampling": n} for n in range(3))], ids=str)
@pytest.mark.parametrize("restart", [{}, {"restart_marker_rows": 1}, {"restart_marker_blocks": 3}])
def test_rewritten_file_decodes_to_the_same_pixels(kind, restart, progressive):
    """Exact, for every quality and size."""
    for quality in (30, 75, 95, 100):
        for size in ((64, 48), (51, 37), (1, 1), (17, 40)):
            data = compressed(
                scene(*size), quality=quality, progressive=progressive, **kind, **restart
            )
            again = jpeg_bytes(read_jpeg(data))
            assert np.array_equal(by_pillow(again), by_pillow(data))
            assert np.array_equal(by_opencv(again), by_opencv(data))


def test_rewritten_file_decodes_in_openimageio(tmp_path):
    """Exact."""
    data = compressed(scene(51, 37), quality=85, progressive=True)
    pixels = []
    for name, content in (("a.jpg", data), ("b.jpg", jpeg_bytes(read_jpeg(data)))):
        (tmp_path / name).write_bytes(content)
        pixels.append(oiio.ImageBuf(str(tmp_path / name)).get_pixels(oiio.UINT8))
    assert np.array_equal(*pixels)


def test_writing_is_idempotent():
    """Exact: the second file is the first, byte by byte."""
    once = jpeg_bytes(read_jpeg(compressed(scene(64, 48), quality=90)))
    assert jpeg_bytes(read_jpeg(once)) == once


def test_file_is_no_longer_than_optimized_by_pillow():
    """Oracle: libjpeg's optimal tables and the same segments."""
    data = compressed(scene(320, 240), quality=90, optimize=True)
    assert len(jpeg_bytes(read_jpeg(data))) <= len(data)


def test_coefficients_are_those_of_the_cosine_transform():
    """Oracle: the definition in T.81 A.3.3, by SciPy."""
    data = compressed(scene(40, 24), quality=80, gray=True)
    jpeg = read_jpeg(data)
    natural = np.empty((3, 5, 64))
    natural[..., ZIGZAG] = jpeg.blocks(0) * jpeg.quantization[0].astype(float)
    blocks = idctn(natural.reshape(3, 5, 8, 8), axes=(2, 3), norm="ortho") + 128
    pixels = np.clip(blocks.swapaxes(1, 2).reshape(24, 40), 0, 255)
    assert_allclose(pixels, by_pillow(data), atol=1)


def test_metadata_segments_are_kept():
    """Exact: unknown segments too."""
    data = compressed(scene(16, 16), comment=b"by hand", icc_profile=b"not really one" * 10)
    strange = b"\xff\xeb\x00\x09strange"
    jpeg = read_jpeg(data[:2] + strange + data[2:])
    assert jpeg.metadata[0] == strange
    again = jpeg_bytes(jpeg)
    assert read_jpeg(again).metadata == jpeg.metadata
    with Image.open(io.BytesIO(again)) as file:
        assert file.info["comment"] == b"by hand"


@pytest.mark.parametrize("kind", [{"gray": True}, *({"subsampling": n} for n in range(3))], ids=str)
@pytest.mark.parametrize("progressive", [False, True])
def test_only_blocks_with_changed_pixels_change(kind, progressive):
    """Exact: others keep their coefficients; these have those of Pillow's new picture."""
    before, after = scene(83, 61), scene(83, 61, seed=1)
    changed = np.zeros((61, 83), bool)
    changed[20:33, 40:83] = changed[60, 3] = True
    data = compressed(before, quality=85, progressive=progressive, **kind)
    jpeg = read_jpeg(data)
    codes = np.asarray(Image.fromarray(after).convert("L")) if "gray" in kind else after
    new = replace_blocks(jpeg, codes, changed)
    whole = read_jpeg(compressed(after, quality=85, **kind))
    width, height = jpeg.mcu
    rows, columns = np.nonzero(changed)
    touched = np.zeros((-(-61 // height), -(-83 // width)), bool)
    touched[rows // height, columns // width] = True
    for place, component in enumerate(jpeg.components):
        mask = touched.repeat(component.down, axis=0).repeat(component.across, axis=1)
        assert np.array_equal(new.blocks(place)[~mask], jpeg.blocks(place)[~mask])
        assert np.array_equal(new.blocks(place)[mask], whole.blocks(place)[mask])
    assert np.array_equal(
        read_jpeg(data).coefficients, jpeg.coefficients
    )  # the input is not modified


def test_quantization_beyond_8_bits_is_kept():
    """Exact: tables of 16 bits need an extended sequential frame."""
    tables = [[300 + k for k in range(64)], [500 - k for k in range(64)]]
    data = compressed(scene(48, 32), qtables=tables, subsampling=2)
    jpeg = read_jpeg(data)
    assert jpeg.quantization[0].max() > 255
    assert np.array_equal(by_pillow(jpeg_bytes(jpeg)), by_pillow(data))
    changed = np.ones((32, 48), bool)
    new = replace_blocks(jpeg, scene(48, 32, seed=2), changed)
    assert np.array_equal(new.quantization, jpeg.quantization)


def test_no_changed_pixel_returns_the_input():
    """Exact."""
    jpeg = read_jpeg(compressed(scene(16, 16)))
    assert replace_blocks(jpeg, scene(16, 16, seed=1), np.zeros((16, 16), bool)) is jpeg


def resampled(across, down):
    """A JPEG whose chroma is subsampled by these factors, made of the blocks of another."""
    data = compressed(scene(64, 64), subsampling=0)
    jpeg = read_jpeg(data)
    parts = [jpeg.blocks(0).reshape(-1, 64)]
    parts += [jpeg.blocks(c)[::down, ::across].reshape(-1, 64) for c in (1, 2)]
    components = (Component(1, across, down), Component(2, 1, 1), Component(3, 1, 1))
    return replace(jpeg, components=components, coefficients=np.concatenate(parts))


@pytest.mark.parametrize("sampling", [(1, 4), (4, 2)])
def test_rare_chroma_sampling_is_read(sampling):
    """Exact: factors that no encoder writes."""
    data = jpeg_bytes(resampled(*sampling))
    assert jpeg_bytes(read_jpeg(data)) == data
    assert by_pillow(data).shape == (64, 64, 3)


@pytest.mark.parametrize("sampling", ["411", "420", "422", "440", "444"])
@pytest.mark.parametrize("progressive", [0, 1])
def test_chroma_sampling_of_opencv_is_read(sampling, progressive):
    """Exact: an encoder with chroma samplings that Pillow does not write."""
    factors = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{sampling}")
    options = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factors, cv2.IMWRITE_JPEG_RST_INTERVAL, 3]
    options += [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive, cv2.IMWRITE_JPEG_QUALITY, 88]
    data = cv2.imencode(".jpg", scene(83, 61), options)[1].tobytes()
    jpeg = read_jpeg(data)
    luma = jpeg.components[0]
    assert (luma.across, luma.down) == {
        "411": (4, 1), "420": (2, 2), "422": (2, 1), "440": (1, 2), "444": (1, 1)
    }[sampling]  # fmt: skip
    assert np.array_equal(by_opencv(jpeg_bytes(jpeg)), by_opencv(data))
    assert np.array_equal(by_pillow(jpeg_bytes(jpeg)), by_pillow(data))


def test_padding_around_the_end_marker_is_ignored():
    """Exact: some cameras pad their files."""
    data = compressed(scene(64, 48))
    jpeg = read_jpeg(data[:-2] + b"\0" * 9 + b"\xff\xff\xd9" + b"\0" * 50)
    assert np.array_equal(jpeg.coefficients, read_jpeg(data).coefficients)


def one_scan_each(jpeg):
    """The file of a JPEG with one scan per component [T.81]."""
    data = b""
    for place, component in enumerate(jpeg.components):
        gray = replace(
            jpeg,
            metadata=(),
            components=(Component(component.number, 1, 1),),
            quantization=(jpeg.quantization[place],),
            coefficients=jpeg.blocks(place).reshape(-1, 64),
        )
        single = jpeg_bytes(gray)
        data += single[single.index(b"\xff\xc4") : -2]  # tables, scan
    whole = jpeg_bytes(jpeg)
    return whole[: whole.index(b"\xff\xc4")] + data + b"\xff\xd9"


def test_scans_of_single_components_are_read():
    """Exact: such scans are coded block by block, not MCU by MCU."""
    jpeg = read_jpeg(compressed(scene(64, 48), subsampling=0))
    data = one_scan_each(jpeg)
    assert np.array_equal(by_pillow(data), by_pillow(jpeg_bytes(jpeg)))
    assert np.array_equal(read_jpeg(data).coefficients, jpeg.coefficients)


@pytest.mark.parametrize("make", [lambda: resampled(1, 2), lambda: resampled(4, 1)])
def test_unsupported_chroma_sampling_is_rejected(make):
    """Door."""
    with pytest.raises(JpegError, match="sampling of the JPEG is not supported"):
        replace_blocks(make(), scene(64, 64), np.ones((64, 64), bool))


def test_rgb_channels_are_rewritten_but_not_replaced():
    """Door: Pillow does not compress RGB channels with given tables."""
    data = compressed(scene(32, 32), keep_rgb=True)
    jpeg = read_jpeg(data)
    assert np.array_equal(by_pillow(jpeg_bytes(jpeg)), by_pillow(data))
    with pytest.raises(JpegError, match="sampling of the JPEG is not supported"):
        replace_blocks(jpeg, scene(32, 32), np.ones((32, 32), bool))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: data[:-500], "truncated"),
        (lambda data: data[:-2], "truncated"),
        (lambda data: data[:300], "truncated"),
        (lambda data: b"", "is no JPEG"),
        (lambda data: data[:2] + b"\xff\xd9", "no picture"),
        (lambda data: with_byte(data, 0xC0, 1, 0xC9), "arithmetic"),
        (lambda data: with_byte(data, 0xC0, 1, 0xC3), "lossless"),
        (lambda data: with_byte(data, 0xC0, 1, 0xC6), "hierarchical"),
        (lambda data: with_byte(data, 0xC0, 4, 12), "12 bits"),
        (lambda data: with_byte(data, 0xC0, 9, 4), "4 channels"),
        (lambda data: with_byte(data, 0xC0, 5, 0xFF), "pixels, more than"),
        (lambda data: with_byte(data, 0xDB, 9, 0), "step is zero"),
        (lambda data: with_byte(data, 0xC4, 6, 200), "inconsistent"),
        (lambda data: with_byte(data, 0xDA, 6, 0x33), "no Huffman table"),
    ],
)
def test_damaged_or_unsupported_file_raises_jpeg_error(damage, words):
    """Door."""
    data = compressed(scene(64, 64), quality=90)
    with pytest.raises(JpegError, match=words):
        read_jpeg(damage(data), max_pixels=1_000_000)


def test_cmyk_is_rejected():
    """Door."""
    file = io.BytesIO()
    Image.fromarray(scene(16, 16)).convert("CMYK").save(file, "JPEG")
    with pytest.raises(JpegError, match="4 channels"):
        read_jpeg(file.getvalue())


def test_progressive_file_without_its_last_scan_is_rejected():
    """Door: decoders disagree about missing scans."""
    data = compressed(scene(64, 64), quality=90, progressive=True)
    cut = data[: data.rindex(b"\xff\xda")] + b"\xff\xd9"
    with pytest.raises(JpegError, match="scans are missing"):
        read_jpeg(cut)


def test_restart_markers_out_of_order_are_rejected():
    """Door."""
    data = compressed(scene(64, 64), restart_marker_blocks=1)
    with pytest.raises(JpegError, match="restart marker"):
        read_jpeg(data.replace(b"\xff\xd1", b"\xff\xd2", 1))


def damaged(data, rng):
    """Cut, with bytes flipped, or with a piece of it replaced."""
    data, at = bytearray(data), int(rng.integers(2, len(data)))
    match rng.integers(3):
        case 0:
            return bytes(data[:at])
        case 1:
            for place in rng.integers(2, len(data), 4):
                data[place] = rng.integers(256)
        case 2:
            data[at : at + int(rng.integers(30))] = rng.bytes(int(rng.integers(30)))
    return bytes(data)


def test_damaged_file_raises_jpeg_error_or_is_read():
    """Door: no other exception; a file that is read can be written and read again."""
    rng = np.random.default_rng(5)
    options = ({}, {"progressive": True}, {"restart_marker_rows": 1}, {"gray": True})
    files = [compressed(scene(45, 37), quality=90, **more) for more in options]
    refused = 0
    for k in range(800):
        try:
            jpeg = read_jpeg(damaged(files[k % 4], rng), max_pixels=10**6)
            again = read_jpeg(jpeg_bytes(jpeg))
        except JpegError:
            refused += 1
            continue
        assert again.size == jpeg.size
    assert 300 < refused < 800


def shortest(counts):
    """Bits of all symbols by Huffman's construction without a length limit."""
    heap = [int(n) for n in counts if n]
    heapq.heapify(heap)
    total = 0
    while len(heap) > 1:
        both = heapq.heappop(heap) + heapq.heappop(heap)
        total += both
        heapq.heappush(heap, both)
    return total


def check_codes(codes, lengths):
    """Codes are prefix-free, not all ones, and at most 16 bits long."""
    assert lengths.max() <= 16
    words = [f"{c:0{n}b}" for c, n in zip(codes.tolist(), lengths.tolist(), strict=True) if n]
    words.sort()
    assert not any(b.startswith(a) for a, b in itertools.pairwise(words))
    assert all("0" in word for word in words)


def test_huffman_codes_are_optimal():
    """Oracle: up to the reserved code, which costs at most one bit of the rarest symbol."""
    rng = np.random.default_rng(0)
    counts = np.zeros(256, np.int64)
    counts[rng.choice(256, 60, replace=False)] = rng.integers(1, 5000, 60)
    symbols, codes, lengths = huffman_codes(counts)
    check_codes(codes, lengths)
    assert sorted(symbols) == np.flatnonzero(counts).tolist()
    with_reserved = shortest([*counts, 1])
    assert with_reserved - 20 <= (counts * lengths).sum() <= with_reserved


def test_huffman_codes_have_at_most_16_bits():
    """Exact: Fibonacci frequencies give the longest codes."""
    counts = np.zeros(256, np.int64)
    counts[:2] = 1
    for k in range(2, 60):
        counts[k] = counts[k - 1] + counts[k - 2]
    symbols, codes, lengths = huffman_codes(counts)
    check_codes(codes, lengths)
    table = table_bytes(0x10, symbols, lengths)
    assert table[0] == 0x10
    assert sum(table[1:17]) == 60
    assert table[17:] == symbols


def test_a_single_symbol_has_a_code():
    """Exact."""
    counts = np.zeros(256, np.int64)
    counts[7] = 3
    symbols, codes, lengths = huffman_codes(counts)
    assert symbols == b"\x07"
    assert (codes[7], lengths[7]) == (0, 1)


def test_frame_segment_contains_16_bit_size():
    """Exact."""
    data = jpeg_bytes(read_jpeg(compressed(scene(300, 7))))
    at = data.index(b"\xff\xc0")
    length, bits, height, width = struct.unpack_from(">HBHH", data, at + 2)
    assert (length, bits, height, width) == (17, 8, 7, 300)
