"""Tags of TIFF and EXIF are copied without interpretation; Pillow is the oracle."""

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import Base as TiffTag
from PIL.TiffImagePlugin import IFDRational

import blurmatte as bm
from blurmatte.files.exif import (
    Tag,
    longs,
    numbers,
    parse_tags,
    rational,
    shorts,
    tags_block,
    without_thumbnail,
)

EXIF, GPS = 0x8769, 0x8825


def block():
    """An EXIF block as Pillow writes it."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0112] = "Example", 6
    exif.get_ifd(EXIF)[0x829A] = IFDRational(1, 60)
    exif.get_ifd(EXIF)[0x9204] = IFDRational(-1, 3)
    exif.get_ifd(EXIF)[0x927C] = b"\0\1\2\3 notes"
    exif.get_ifd(GPS)[2] = (IFDRational(52), IFDRational(30), IFDRational(3, 2))
    return exif.tobytes().removeprefix(b"Exif\0\0")


def by_pillow(data):
    exif = Image.Exif()
    exif.load(b"Exif\0\0" + data)
    own = {tag: value for tag, value in exif.items() if tag not in (EXIF, GPS)}
    return own, dict(exif.get_ifd(EXIF)), dict(exif.get_ifd(GPS))


@pytest.mark.parametrize("order", ["<", ">"])
def test_tags_round_trip_in_both_byte_orders(order):
    """Exact: types and values, and so for Pillow."""
    tags = parse_tags(block())
    packed = tags_block(tags, order)
    assert packed[:2] == {"<": b"II", ">": b"MM"}[order]
    assert parse_tags(packed) == tags
    assert by_pillow(packed) == by_pillow(block())


def test_values_of_every_type():
    """Exact: as Pillow understands them, and the same again when they are moved once more."""
    tags = {
        0x0112: shorts(6),
        0x0100: longs(70_000),
        0x011A: rational(299.5),
        0xC001: Tag(12, 2, np.array([0.1, -2.5]).astype(">f8").tobytes()),
        0xC002: Tag(8, 3, np.array([-1, 2, -3]).astype(">i2").tobytes()),
    }
    for order in "<>":
        own, _, _ = by_pillow(tags_block(tags, order))
        assert own[0x0112] == 6
        assert own[0x0100] == 70_000
        assert float(own[0x011A]) == 299.5
        assert own[0xC001] == (0.1, -2.5)
        assert own[0xC002] == (-1, 2, -3)
    assert numbers(tags[0x011A]) == [299_500, 1000]


@pytest.mark.parametrize("extension", ["jpg", "png", "webp"])
@pytest.mark.parametrize(
    "time",
    [
        shorts(1, 250),
        longs(1, 250),
        rational(0.004),
        Tag(11, 1, np.array([0.004], ">f4").tobytes()),
        Tag(12, 1, np.array([0.004], ">f8").tobytes()),
    ],
    ids=["shorts", "longs", "rational", "float", "double"],
)
def test_exposure_time_of_any_type_is_read(tmp_path, time, extension):
    """Oracle: 1/250 s, in the type that EXIF wants and in those of other programs."""
    exif = b"Exif\0\0" + tags_block({TiffTag.ExifOffset: {TiffTag.ExposureTime: time}})
    file = tmp_path / f"a.{extension}"
    Image.fromarray(np.full((16, 16, 3), 100, np.uint8)).save(file, exif=exif)
    assert bm.read(file, transfer=bm.SRGB).meta.exposure_time == pytest.approx(0.004)


def test_block_without_thumbnail_is_unchanged():
    """Exact: so does what is no EXIF."""
    for data in (block(), b"", b"nothing of the kind at all", block()[:20]):
        assert without_thumbnail(data) == data


def test_damaged_block_raises_value_error_or_omits_tags():
    """Door: no other exception, and the remaining tags can be written."""
    rng = np.random.default_rng(8)
    refused = 0
    for _ in range(1000):
        data = bytearray(block())
        for place in rng.integers(0, len(data), 3):
            data[place] = rng.integers(256)
        data = bytes(data[: rng.integers(10, 2 * len(data))])
        assert len(without_thumbnail(data)) == len(data)
        try:
            tags = parse_tags(data)
        except ValueError:
            refused += 1
            continue
        assert parse_tags(tags_block(tags)) == tags
    assert 50 < refused < 950


def test_overlapping_values_do_not_exhaust_memory():
    """Door: each tag may claim the whole block, all together not."""
    entries = b"".join(
        tag.to_bytes(2) + b"\0\x01" + (4000).to_bytes(4) + (8).to_bytes(4) for tag in range(300)
    )
    data = b"MM\0*\0\0\0\x08" + (300).to_bytes(2) + entries + b"\0" * 1000
    with pytest.raises(ValueError, match="damaged"):
        parse_tags(data)
