"""Scenes rendered and photographed once, for the tests of several packages."""

from functools import lru_cache

from blurmatte.rendering import Shot, render


@lru_cache(maxsize=64)
def rendered(scene, substeps=200):
    """The truth of a scene."""
    return render(scene, substeps)


@lru_cache(maxsize=64)
def photographed(scene, camera, seed=0, plate_frames=3, substeps=200):
    """Image and plate as a camera takes them; the plate is the median of several pictures."""
    shot = Shot(scene, camera, plate_frames=plate_frames, seed=seed)
    return shot.photograph(rendered(scene, substeps))
