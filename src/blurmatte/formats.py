"""What a file is: the formats, each with what it holds, its extensions, and how its content begins.

The content decides. Only where it says nothing, or as much as TIFF of a camera RAW, does the extension.
A format that is not read has a remedy. A new format is a row of `FORMATS`; for one that is read, a
function that reads it, by the library in `reader`.
"""

import re
from dataclasses import dataclass
from enum import Enum, Flag, auto
from os import PathLike
from pathlib import Path

MAX_PIXELS = 200_000_000  # default limit of pictures that are read
HEAD_BYTES = 400  # of the content that decide: two packets of an MPEG transport stream
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class Holds(Enum):
    """What is in a file."""

    PICTURE = auto()
    RAW = auto()  # the sensor data of one picture
    CLIP = auto()
    OTHER = auto()  # nothing that is read


class Writes(Flag):
    """What can be written into a file of a format."""

    NOTHING = 0
    PICTURE = auto()
    SHEET = auto()  # pictures to look at
    LAYER = auto()  # pictures with alpha
    CLIP = auto()
    LAYERS = auto()  # clips with alpha


@dataclass(frozen=True)
class Format:
    """A format of files."""

    name: str
    holds: Holds
    extensions: tuple[str, ...]  # the first is the one that is written
    content: bytes = b""  # a regular expression of the first HEAD_BYTES; empty if nothing marks it
    reader: str = ""  # the library that decodes it
    writes: Writes = Writes.NOTHING
    remedy: str = ""  # if it is not read

    def __str__(self) -> str:
        return self.name

    @property
    def one_picture(self) -> bool:
        """Whether it holds a single picture that is read."""
        return self.holds in (Holds.PICTURE, Holds.RAW)


def _picture(
    name: str, extensions: str, content: bytes, reader: str, writes: Writes = Writes.NOTHING
) -> Format:
    return Format(name, Holds.PICTURE, _split(extensions), content, reader, writes)


def _clip(name: str, extensions: str, content: bytes, writes: Writes = Writes.NOTHING) -> Format:
    return Format(name, Holds.CLIP, _split(extensions), content, "PyAV", writes)


def _other(name: str, extensions: str, content: bytes, remedy: str = "") -> Format:
    return Format(
        name, Holds.OTHER, _split(extensions), content, remedy=remedy or "convert it to PNG or TIFF"
    )


def _split(extensions: str) -> tuple[str, ...]:
    return tuple(f".{one}" for one in extensions.split())


_IMAGE, _LAYERS = Writes.PICTURE | Writes.LAYER, Writes.CLIP | Writes.LAYERS

EXR = _picture("EXR", "exr", rb"\x76\x2f\x31\x01", "OpenImageIO", _IMAGE)
PNG = _picture("PNG", "png", re.escape(PNG_SIGNATURE), "OpenImageIO", _IMAGE | Writes.SHEET)
TIFF = _picture("TIFF", "tif tiff", rb"II[*+]\0|MM\0[*+]", "OpenImageIO", _IMAGE)
JPEG = _picture(
    *("JPEG", "jpg jpeg jpe jfif jif", rb"\xff\xd8\xff", "OpenImageIO"),
    Writes.PICTURE | Writes.SHEET,
)
FITS = _picture("FITS", "fits fit fts", rb"SIMPLE  =", "OpenImageIO")
BMP = _picture("BMP", "bmp dib", rb"BM.{4}\0{4}", "OpenImageIO")
WEBP = _picture("WebP", "webp", rb"RIFF.{4}WEBP", "Pillow", Writes.CLIP)
AVIF = _picture("AVIF", "avif", rb".{4}ftyp(avi[fs]|mif1.{4}(.{4})*?avif)", "Pillow")
HEIC = _picture("HEIC", "heic heif hif", rb".{4}ftyp(he[iv][cxms]|mif1|msf1)", "pillow-heif")
RAW = Format(
    "camera RAW",
    Holds.RAW,
    _split(
        "dng 3fr arw cr2 cr3 crw dcr erf fff iiq k25 kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl "
        "sr2 srf srw x3f"
    ),
    # Canon (3), Fujifilm, Olympus (3), Panasonic, Sigma, Minolta; others begin like a TIFF.
    rb"II\*\0.{4}CR|.{4}ftypcrx |II.{4}HEAPCCDR|FUJIFILMCCD-RAW|IIR[OS]|MMOR|IIU\0|FOVb|\0MRM",
    "rawpy",
)
MOV = _clip("QuickTime", "mov qt", rb".{4}(ftypqt  |moov|mdat|wide|pnot)", _LAYERS)
MP4 = _clip("MP4", "mp4 m4v 3gp", rb".{4}(ftyp|free|skip)", Writes.CLIP)
GIF = _clip("GIF", "gif", rb"GIF8[79]a", Writes.CLIP)

# The first one whose content matches is meant. In the order in which choices are listed for people.
FORMATS = (
    *(RAW, EXR, PNG, TIFF, JPEG, WEBP, BMP, AVIF, HEIC, FITS),
    _other("JPEG XL", "jxl", rb"\xff\x0a|\0{3}\x0cJXL "),
    _other("JPEG 2000", "jp2 j2k jpx", rb"\0{3}\x0cjP  |\xff\x4f\xff\x51"),
    *(MOV, MP4, GIF),
    _clip("Matroska", "mkv webm", rb"\x1a\x45\xdf\xa3"),
    _clip("AVI", "avi", rb"RIFF.{4}AVI "),
    _clip("MPEG", "mpg mpeg vob m2v", rb"\0\0\x01[\xb3\xba]"),
    _clip("MPEG transport stream", "ts mts m2ts", rb"(.{4})?G.{187}(.{4})?G"),
    _clip("Windows Media", "wmv asf", rb"\x30\x26\xb2\x75\x8e\x66\xcf\x11"),
    _clip("Flash video", "flv", rb"FLV\x01"),
    _clip("Ogg", "ogv ogg", rb"OggS"),
    _clip("MXF", "mxf", rb"\x06\x0e\x2b\x34"),
    _clip("YUV4MPEG", "y4m", rb"YUV4MPEG2"),
    _clip("a stream of H.264 or H.265", "h264 264 h265 265 hevc", rb"\0{2,3}\x01[\x67\x40\x42]"),
    _other("Photoshop", "psd psb", rb"8BPS", "export it as PNG or TIFF"),
    _other("Radiance HDR", "hdr rgbe", rb"#\?(RADIANCE|RGBE)", "convert it to EXR"),
    _other("DPX", "dpx", rb"SDPX|XPDS", "convert it to EXR"),
    _other("Cineon", "cin", rb"\x80\x2a\x5f\xd7", "convert it to EXR"),
    _other("PNM", "pnm ppm pgm pbm pfm", rb"P[1-7fF]\s"),
    _other("icon", "ico", rb"\0\0\x01\0[^\0]\0"),
    _other("TARGA", "tga", b""),
    _other("DDS", "dds", rb"DDS "),
    _other("SGI", "sgi rgb", rb"\x01\xda[\0\x01][\x01\x02]"),
    _other("PDF", "pdf", rb"%PDF", "export it as PNG or TIFF"),
    _other("ZIP archive", "zip", rb"PK\x03\x04", "unpack it"),
    _other(
        "web page or drawing", "svg html htm xml", rb"\s*<[!?a-z]", "download the picture itself"
    ),
    _other("text", "json toml csv txt", b"", "give a picture or a clip"),
    _other("playlist", "m3u8 m3u", rb"#EXTM3U|ffconcat", "give the clip itself"),
)


def extensions(*held: Holds) -> tuple[str, ...]:
    """The extensions of the formats that hold one of these."""
    return tuple(name for form in FORMATS if form.holds in held for name in form.extensions)


def written(*what: Writes) -> tuple[str, ...]:
    """The extensions with which one of these is written, each once."""
    found = (form for one in what for form in FORMATS if one in form.writes)
    return tuple(dict.fromkeys(form.extensions[0] for form in found))


def named(path: str | PathLike[str]) -> Format | None:
    """The format that the extension of a name stands for."""
    suffix = Path(path).suffix.lower()
    return next((form for form in FORMATS if suffix in form.extensions), None)


def recognized(head: bytes, path: str | PathLike[str]) -> Format | None:
    """The format of a file with these first bytes; None if it is not known.

    A file whose content says nothing is what its extension says, unless content marks that format.
    """
    by_name = named(path)
    found = next((f for f in FORMATS if f.content and re.match(f.content, head, re.DOTALL)), None)
    if found is TIFF and by_name is RAW:
        return RAW
    if found is MP4 and by_name is MOV:
        return MOV
    unmarked = by_name is not None and (not by_name.content or by_name.holds is not Holds.PICTURE)
    return found or (by_name if unmarked else None)


NUMBERS = ".json", ".csv"  # of one thing, or of rows
# Tables of tracks for other programs, by the ends of their names; that of Tracker holds one object.
NAPARI, TRACKMATE, KINOVEA = ".napari.csv", ".trackmate.xml", ".kinovea.txt"
TRACKER = ".tracker.txt"
TABLES = ".csv", ".json", ".parquet", NAPARI, TRACKMATE, KINOVEA, TRACKER


def format_at(path: str | PathLike[str]) -> Format | None:
    """The format of a file; of one that cannot be read, or is not there, that of its name."""
    try:
        if not Path(path).is_file():  # a pipe may be endless
            return named(path)
        with Path(path).open("rb") as file:
            return recognized(file.read(HEAD_BYTES), path)
    except (OSError, ValueError):
        return named(path)


def is_clip(path: str | PathLike[str]) -> bool:
    """Whether a file is a clip, or unknown: there are more kinds of clips than are listed here."""
    form = format_at(path) or named(path)
    return form is None or form.holds is Holds.CLIP


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by their names; camera RAW only if there are no others.

    Hidden files are none, like those that macOS leaves on other disks.
    """
    for held in (Holds.PICTURE, Holds.RAW):
        known = extensions(held)
        visible = (path for path in folder.iterdir() if not path.name.startswith("."))
        if found := [path for path in visible if path.suffix.lower() in known]:
            return found
    return []
