import numpy as np

from blurmatte.color.model import ColorModel
from blurmatte.motion.clip.matched_filter import MatchedFilter
from blurmatte.radiometry import LinearImage, NoiseModel

MODEL = ColorModel(
    np.array([[0.8], [0.5], [0.1]]) / np.linalg.norm([0.8, 0.5, 0.1]), np.zeros((3, 3))
)


def test_filter_made_in_strips_is_that_of_the_whole_picture():
    # exact
    rng = np.random.default_rng(0)
    light = rng.uniform(0.1, 0.9, (130, 41, 3)).astype(np.float32)
    valid = rng.uniform(size=(130, 41)) < 0.95
    plate = LinearImage(light, NoiseModel(read_std=0.01), valid)
    image = LinearImage(
        light + rng.normal(0, 0.05, light.shape).astype(np.float32), NoiseModel(read_std=0.02)
    )
    whole = MatchedFilter.of(plate, image.crop, MODEL)
    strips = MatchedFilter.of(plate, image.crop, MODEL, strip=8)
    assert np.array_equal(whole.weight, strips.weight)
    assert np.array_equal(whole.std, strips.std)
    assert whole.inflation == strips.inflation > 1
