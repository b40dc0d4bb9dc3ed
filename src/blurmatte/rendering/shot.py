"""Shot: a scene, and how it is photographed."""

from dataclasses import dataclass, field, replace

import numpy as np

from blurmatte.checks import check_kind
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.camera import Camera
from blurmatte.rendering.drift import Drift
from blurmatte.rendering.render import Rendering
from blurmatte.rendering.scene import Scene, check_scene


@dataclass(frozen=True, eq=False)
class Shot:
    """A scene, the camera, and what goes wrong between the picture of the plate and the image.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    drift : Drift
        How the plate's picture lies beside the plate that was behind the body.
    plate_frames : int
        Of how many pictures the plate is the median.
    seed : int
        Of the noise.

    Raises
    ------
    ValueError
        If `plate_frames` < 1.
    """

    scene: Scene
    camera: Camera = field(default_factory=Camera)
    drift: Drift = field(default_factory=Drift)
    plate_frames: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        check_scene("scene", self.scene)
        if self.plate_frames < 1:
            raise ValueError(f"plate_frames must be 1 or more, got {self.plate_frames}")

    def photograph(self, rendering: Rendering) -> tuple[LinearImage, LinearImage]:
        """Image and plate of a rendering of its scene, as files would give them back.

        The image is taken first: the same noise, however many frames the plate has. The noise of a
        plate of several frames is not known, for a median has no simple model.
        """
        check_kind("rendering", rendering, Rendering, "use blurmatte.render(scene)")
        rng = np.random.default_rng(self.seed)
        image = self.camera.photograph(rendering.image.rgb, rng)
        behind = self.drift.apply(rendering.plate.rgb)
        frames = [self.camera.photograph(behind, rng) for _ in range(self.plate_frames)]
        if len(frames) == 1:
            return image, frames[0]
        rgb = np.median([frame.rgb for frame in frames], axis=0)
        valid = np.median([frame.valid for frame in frames], axis=0) > 0.5
        return image, replace(frames[0], rgb=rgb, noise=None, valid=valid)
