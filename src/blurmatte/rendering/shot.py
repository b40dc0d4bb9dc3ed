"""Shot: a scene, and how it is photographed."""

from dataclasses import dataclass, field

from blurmatte.checks import check_kind
from blurmatte.radiometry import LinearImage
from blurmatte.rendering.camera import Camera
from blurmatte.rendering.drift import Drift
from blurmatte.rendering.pair import photograph_pair
from blurmatte.rendering.render import Rendering
from blurmatte.rendering.scene import Scene, check_scene
from blurmatte.rendering.video import check_crf


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
    crf : float, optional
        Image and plate are frames of one H.264 clip of this constant rate factor, 0…51.

    Raises
    ------
    ValueError
        If `plate_frames` < 1 or `crf` is outside its range.
    """

    scene: Scene
    camera: Camera = field(default_factory=Camera)
    drift: Drift = field(default_factory=Drift)
    plate_frames: int = 1
    seed: int = 0
    crf: float | None = None

    def __post_init__(self) -> None:
        check_scene("scene", self.scene)
        if self.plate_frames < 1:
            raise ValueError(f"plate_frames must be 1 or more, got {self.plate_frames}")
        if self.crf is not None:
            check_crf(self.crf)

    def photograph(self, rendering: Rendering) -> tuple[LinearImage, LinearImage]:
        """Image and plate of a rendering of its scene, as files would give them back.

        See `photograph_pair`.
        """
        check_kind("rendering", rendering, Rendering, "use blurmatte.render(scene)")
        behind = self.drift.apply(rendering.plate.rgb)
        return photograph_pair(
            self.camera, rendering.image.rgb, behind, self.seed, self.plate_frames, self.crf
        )
