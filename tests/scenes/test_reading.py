"""Scene files: their contents, and errors of wrong ones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import FileError
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.radiometry import LINEAR, SRGB, LinearImage
from blurmatte.rendering import Ball, colorful_plate
from blurmatte.rendering.flat_bodies import Cube, Sprite
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.pose import Pinhole
from blurmatte.rendering.processing import Processing
from blurmatte.rendering.scene import Nearby
from blurmatte.scenes import read_shots, scene_names, scene_title

PLAIN = """
size = [64, 48]
seed = 3

[plate]
kind = "plain"
color = [0.3, 0.4, 0.5]

[body]
kind = "ball"
radius = 6
color = "#ff8000"

[path]
kind = "line"
start = [20, 24]
end = [40, 24]
"""


@pytest.fixture
def shots(tmp_path):
    """The shots of a scene file with this text."""

    def read(text):
        (tmp_path / "scene.toml").write_text(text)
        return read_shots(tmp_path / "scene.toml")

    return read


def test_scene_has_the_values_of_its_file(shots):
    (shot,) = shots(PLAIN)
    assert shot.scene.size == (64, 48)
    assert shot.seed == 3
    assert_allclose(shot.scene.plate, plain_plate((64, 48), (0.3, 0.4, 0.5), 3))
    assert isinstance(shot.scene.body, Ball)
    assert_allclose(shot.scene.body.color, SRGB.decode(np.array([255, 128, 0]) / 255))
    assert_allclose(shot.scene.trajectory.xy, [(20, 24), (40, 24)])


def test_every_table_is_read(shots):
    text = PLAIN.replace('kind = "ball"\nradius = 6', 'kind = "cube"\nside = 8')
    (shot,) = shots(
        "opacity = 0.8\ndefocus = 2\nshutter_ramp = 0.1\npixel_filter = 1.5\n"
        "plate_frames = 3\ncrf = 23\n"
        + text
        + """
[change]
turned = [0, 90, 0]
squash_angle = 45
[shadow]
offset = [5, 6]
strength = [0.5, 0.4, 0.3]
[nearby]
occlusion = 0.03
bounce = 0.01
reach = 1.5
[occluder]
kind = "wire_fence"
spacing = 20
width = 2
color = [0.1, 0.1, 0.1]
[drift]
shift = [0.5, 0]
rotation = 180
[camera]
gain = 1e-4
bits = "float"
transfer = "linear"
blur = 0.7
defocus = 1.5
[processing]
noise_reduction = 1
tone = 0.2
"""
    )
    scene = shot.scene
    assert (scene.opacity, scene.defocus, scene.shutter_ramp) == (0.8, 2, 0.1)
    assert scene.pixel_filter == 1.5
    assert scene.nearby == Nearby(occlusion=0.03, bounce=0.01, reach=1.5)
    assert scene.pinhole is None
    assert isinstance(scene.body, Cube)
    assert_allclose(scene.change.turned, (0, np.pi / 2, 0))
    assert scene.change.squash_angle == pytest.approx(np.pi / 4)
    assert scene.shadow.strength == (0.5, 0.4, 0.3)
    assert scene.occluder.size == (64, 48)
    assert shot.drift.shift == (0.5, 0)
    assert shot.drift.rotation == pytest.approx(np.pi)
    assert shot.plate_frames == 3
    assert shot.camera.bits is None
    assert shot.camera.transfer is LINEAR
    assert (shot.camera.blur, shot.camera.defocus) == (0.7, 1.5)
    assert shot.camera.processing == Processing(noise_reduction=1, tone=0.2)
    assert shot.crf == 23
    assert shot.camera.noise.gain == (1e-4,) * 3


def test_pinhole_is_read(shots):
    text = PLAIN.replace('kind = "line"', 'kind = "in_depth"\ndepth = [1, 0.5]')
    (shot,) = shots(text + "[change]\ndepth = [1, 0.5]\n[pinhole]\nfocal = 90\ncenter = [30, 20]\n")
    assert shot.scene.pinhole == Pinhole(90, (30, 20))
    assert shot.scene.change.depth == (1, 0.5)
    assert_allclose(shot.scene.trajectory.at(0.5), np.average([(20, 24), (40, 24)], 0, [2, 1]))


def test_lamps_and_texture_of_a_ball(shots):
    lamps = 'lamps = [{ direction = [1, 0, 1], color = "#ff0000" }, { direction = [0, 1, 1] }]'
    texture = 'texture = { kind = "colorful", tile = 30 }'
    (shot,) = shots(PLAIN.replace("radius = 6", f"radius = 6\n{lamps}\n{texture}"))
    red, white = shot.scene.body.lamps
    assert_allclose(red.color, (1, 0, 0))
    assert_allclose(white.direction, (0, 1, 1))
    assert_allclose(shot.scene.body.texture, colorful_plate((256, 128), 3, tile=30))


def test_picture_paths_are_relative_to_the_scene_file(shots, tmp_path):
    write(tmp_path / "wall.exr", LinearImage(np.full((48, 64, 3), 0.25)))
    write(tmp_path / "leaf.exr", Layer(np.ones((5, 7)), np.full((5, 7, 3), 0.5)))
    text = PLAIN.replace('"plain"\ncolor = [0.3, 0.4, 0.5]', '"file"\nfile = "wall.exr"')
    text = text.replace('"ball"\nradius = 6\ncolor = "#ff8000"', '"sprite"\nfile = "leaf.exr"')
    (shot,) = shots(text)
    assert_allclose(shot.scene.plate, 0.25)
    assert isinstance(shot.scene.body, Sprite)


def test_clip_is_a_list_of_shots_with_independent_noise(shots):
    frames = shots(PLAIN + "[clip]\ncount = 2\nduty = 0.5\n")
    assert [shot.seed for shot in frames] == [3, 4]
    assert_allclose(frames[0].scene.trajectory.xy, [(20, 24), (25, 24)])
    assert_allclose(frames[1].scene.trajectory.xy, [(30, 24), (35, 24)])


@pytest.mark.parametrize("name", scene_names())
def test_named_scenes_are_complete(name):
    for shot in read_shots(name):
        assert shot.scene.size == (512, 384)
    assert scene_title(name)


def test_there_are_at_least_twenty_named_scenes():
    assert len(scene_names()) >= 20


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("size = [64, 48]", "", "size must be [width, height] in whole pixels, got None"),
        ("size = [64, 48]", "size = [64.5, 48]", "size must be"),
        ("size = [64, 48]", "size = [64, 0]", "size must be 1 or more, got [64, 0]"),
        ("seed = 3", "sed = 3", "there is no 'sed' in a scene; it takes title, size"),
        ("[path]", "[way]", "there is no 'way' in a scene"),
        ('kind = "plain"', 'kind = "plane"', "[plate] kind must be one of plain, two_hue"),
        ("radius = 6", "radus = 6", "[body] has no 'radus'; it takes radius, color"),
        ("radius = 6", "", "[body] needs 'radius'"),
        ("radius = 6", "radius = -6", "[body] radius must be a positive number of pixels"),
        ("radius = 6", 'radius = "big"', "body.radius must be numbers or a color"),
        ('"#ff8000"', '"#ff80"', "body.color must be a color like #d8ff3c, got '#ff80'"),
        ('"#ff8000"', "[1, 2]", "[body] color must be three linear values"),
        ("radius = 6", "radius = 6\nlamps = [3]", "[body] lamps must"),
        ("start = [20, 24]", "start = [20]", "[path] start must be one point (x, y)"),
        ("[path]", "[camera]\nbits = 9\n[path]", "[camera] bits must be"),
        ("[path]", "[nearby]\nreach = 0\n[path]", "[nearby] reach must be a positive number"),
        ("[path]", "[pinhole]\n[path]", "[pinhole] needs 'focal'"),
        ("[path]", "[pinhole]\nfocal = 5\n[path]", "focal must be larger than the ball's radius"),
        ("[path]", "[processing]\ntone = 2\n[path]", "[processing] tone must lie between 0 and 1"),
        ("[path]", "[clip]\ncount = 2\n[path]", "[clip] needs 'duty'"),
        ("size = [64, 48]", "size = [", "Invalid value"),
        ("size = [64, 48]", "size = [64, 48]\nopacity = 2", "opacity must be above 0"),
    ],
)
def test_rejects_wrong_files(shots, old, new, says):
    with pytest.raises(FileError) as caught:
        shots(PLAIN.replace(old, new))
    assert says in str(caught.value)
    assert "scene.toml: " in str(caught.value)


def test_error_for_unknown_scene_lists_the_names():
    with pytest.raises(
        FileError, match=r"nowhere: check the name; there is no such file; .* easy, "
    ):
        read_shots("nowhere")
