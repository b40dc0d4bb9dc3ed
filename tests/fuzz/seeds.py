"""Small valid files of every format, from which the damaged ones are made.

`make_seeds` writes them into one folder. Their names are those of `tests.fuzz.commands`.
"""

import io
import struct
from contextlib import redirect_stdout
from pathlib import Path
from unittest.mock import patch

import av
import numpy as np
import pillow_heif
import tifffile
from PIL import Image
from tests.files.conftest import write_dng

import blurmatte as bm
from blurmatte.cli import app, clips
from blurmatte.files.models import path_to_mapping
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.trajectory import Trajectory

SIZE = 48, 36
COLOR = "#ffc032"
FRAMES = 5
SCENE = """size = [48, 36]
seed = 3
[plate]
kind = "textured"
[body]
kind = "ball"
radius = 5.5
color = "#ffc032"
[path]
kind = "line"
start = [8, 12]
end = [22.5, 11]
[camera]
bits = 16
gain = 1e-4
read_std = 0.001
transfer = "srgb"
[shadow]
offset = [3, 2]
[drift]
shift = [0.1, 0.0]
gain = [1.0, 1.0, 1.0]
"""
RESOURCE = b"8BIM\4\x0c\0\0\0\0\0\4data"
CAMCHAIN = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.02, 0.01, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [60.0, 60.0, 24.0, 18.0]
  resolution: [48, 36]
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.1]
"""
XMP = b"""http://ns.adobe.com/xap/1.0/\0<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/"
 hdrgm:Version="1.0" xmlns:C="http://ns.google.com/photos/1.0/container/"><C:Directory><C:Item/>
</C:Directory></rdf:Description>"""
CLIPS = {"clip.mp4": "mpeg4", "clip.mov": "mpeg4", "clip.mkv": "mpeg4", "clip.ts": "mpeg2video"}


def make_seeds(folder: Path) -> None:
    """Write all seeds into a folder that exists."""
    light = np.clip(bm.SRGB.decode(np.array([255, 192, 50]) / 255), 0, 1)
    plate = colorful_plate(SIZE, 1, tile=9)
    scene = Scene(plate, Trajectory.line((12, 20), (34, 16)), Ball(6, light))
    noise = np.random.default_rng(0)

    def taken(picture):
        rgb = picture + noise.normal(0, 0.002, picture.shape)
        return bm.LinearImage(np.clip(rgb, 0, 1), bm.NoiseModel(1e-5, 2e-3))

    image, empty = taken(render(scene).image.rgb), taken(plate)
    _write_pictures(folder, "image", image)
    _write_pictures(folder, "plate", empty)
    frames = [taken(render(part).image.rgb) for part in scene.exposures(FRAMES, 0.5)]
    codes = [_codes(frame) for frame in frames]
    for name, codec in CLIPS.items():
        _write_clip(folder / name, codec, codes)
    _write_joined(folder)
    (folder / "frames").mkdir()
    for number, frame in enumerate(codes):
        Image.fromarray(frame).save(folder / "frames" / f"f{number}.png")
    mosaic = np.rint(1000 + 9000 * image.rgb.mean(axis=-1)).astype(np.uint16)
    write_dng(folder / "image.dng", mosaic)
    _write_documents(folder)
    _write_results(folder)


def _codes(picture):
    return np.rint(255 * bm.SRGB.encode(picture.rgb)).astype(np.uint8)


def _write_pictures(folder, name, picture):
    codes = _codes(picture)
    bm.write(folder / f"{name}.png", picture)
    bm.write(folder / f"{name}.exr", picture)
    Image.fromarray(codes).save(folder / f"{name}8.png")
    exif = Image.Exif()
    exif[0x0112] = 1
    exif[0x829A] = 1 / 60
    Image.fromarray(codes).save(folder / f"{name}.jpg", quality=95, subsampling=0, exif=exif)
    jpeg = (folder / f"{name}.jpg").read_bytes()
    segments = (0xE1, XMP), (0xE2, b"MPF\0MM\0*"), (0xED, b"Photoshop 3.0\0" + 2 * RESOURCE)
    further = (bytes([255, mark]) + struct.pack(">H", len(x) + 2) + x for mark, x in segments)
    (folder / f"{name}.jpg").write_bytes(jpeg[:2] + b"".join(further) + jpeg[2:] + jpeg)
    for form in ("webp", "avif", "bmp"):
        Image.fromarray(codes).save(folder / f"{name}.{form}")
    pillow_heif.from_bytes("RGB", SIZE, codes.tobytes()).save(folder / f"{name}.heic", quality=90)
    tifffile.imwrite(folder / f"{name}.tif", codes, photometric="rgb")
    tifffile.imwrite(
        folder / f"{name}16.tif",
        257 * codes.astype(np.uint16),
        photometric="rgb",
        compression="zlib",
    )


def _write_clip(path, codec, frames):
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=30)
        stream.width, stream.height = SIZE
        stream.pix_fmt, stream.bit_rate = "yuv420p", 4_000_000
        for codes in frames:
            for packet in stream.encode(av.VideoFrame.from_ndarray(codes, "rgb24")):
                file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)


def _write_joined(folder):
    """Clips whose time stamps go back, repeat, or whose first key frame is missing."""
    stream = (folder / "clip.ts").read_bytes()
    (folder / "joined.ts").write_bytes(stream + stream)
    packets = []
    with av.open(str(folder / "clip.mkv")) as clip:
        (video,) = clip.streams.video
        packets = [packet for packet in clip.demux(video) if packet.size]
        with av.open(str(folder / "same.mkv"), "w") as out:
            target = out.add_stream_from_template(video)
            for packet in packets:
                packet.stream = target
                packet.pts = packet.dts = packet.pts - packet.pts % (2 * packet.duration)
                out.mux(packet)
    with av.open(str(folder / "clip.mkv")) as clip:
        (video,) = clip.streams.video
        with av.open(str(folder / "cut.mkv"), "w") as out:
            target = out.add_stream_from_template(video)
            for packet in [packet for packet in clip.demux(video) if packet.size][1:]:
                packet.stream = target
                out.mux(packet)


def _write_documents(folder):
    model = bm.ColorModel.from_hex(COLOR)
    model = bm.ColorModel(model.basis, 1e-6 * np.eye(3), {"samples": 0.1})
    bm.write(folder / "model.json", model)
    bm.write(folder / "noise.json", bm.NoiseModel(1e-5, 2e-3, 1e-3))
    bm.write(
        folder / "curve.json", bm.radiometry.Transfer.from_table("mine", np.linspace(0, 1, 17))
    )
    lens = bm.Intrinsics(60, 60, 24, 18, [0.01, 0, 0, 0], size=SIZE)
    bm.write(folder / "lens.json", lens)
    (folder / "scene.toml").write_text(SCENE)
    (folder / "lens.yaml").write_text(CAMCHAIN)
    mask = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    mask[8:28, 6:40, 3] = 255
    Image.fromarray(mask).save(folder / "mask.png")


def _write_results(folder):
    """A solution of each solver, a rendered scene with its truth, and an unfinished table."""

    def run(*args):
        with redirect_stdout(io.StringIO()):
            app([str(arg) for arg in (*args, "-q")], standalone_mode=False)

    image, plate = folder / "image.png", folder / "plate.png"
    given = "--color", COLOR, "--transfer", "srgb"  # nothing else is tried
    for solver in ("pixelwise", "swept"):
        out = folder / solver
        run("solve", image, "--plate", plate, "--solver", solver, *given, "--out", out)
        (out / "layer.exr").rename(folder / f"{solver}.exr")
        (out / "layer.png").rename(folder / f"{solver}.png")
        for file in out.iterdir():
            file.unlink()
        out.rmdir()
    run("render", folder / "scene.toml", "--out", folder / "truth")
    bm.write(folder / "path.json", path_to_mapping(Trajectory.line((8, 12), (22, 11)), 5.5))
    with patch.object(clips, "remove_unfinished", lambda path: None):
        track = "track", folder / "frames", "--plate", plate, "--color", COLOR, "--rate", 30
        run(*track, "--workers", 1, "--out", folder / "table.csv")
    (folder / "table.csv.unfinished").rename(folder / "journal.csv")
