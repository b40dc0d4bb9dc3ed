"""The plate: made of many frames, and matched to the moment of an image."""

from blurmatte.background.burst import burst_plate as burst_plate
from blurmatte.background.camera_motion import CameraMotionError as CameraMotionError
from blurmatte.background.camera_motion import looks_alike as looks_alike
from blurmatte.background.fit_match import Matching as Matching
from blurmatte.background.fit_match import agreement as agreement
from blurmatte.background.fit_match import fit_match as fit_match
from blurmatte.background.fit_match import match_plate as match_plate
from blurmatte.background.guess import PlateGuess as PlateGuess
from blurmatte.background.guess import guess_plate as guess_plate
from blurmatte.background.match import Match as Match
from blurmatte.background.parallax import camera_path as camera_path
from blurmatte.background.parallax import parallax_between as parallax_between
from blurmatte.background.plate import PlateFit as PlateFit
from blurmatte.background.plate import camera_path_after as camera_path_after
from blurmatte.background.plate import make_plate as make_plate
from blurmatte.background.plate import plate_for_clip as plate_for_clip
from blurmatte.background.plate import plate_on_canvas as plate_on_canvas
from blurmatte.background.registration import CameraPath as CameraPath
from blurmatte.background.registration import ParallaxRegion as ParallaxRegion
from blurmatte.background.registration import show_one_scene as show_one_scene
from blurmatte.background.samples import CutError as CutError
from blurmatte.background.samples import max_coded_samples as max_coded_samples
from blurmatte.background.shots import ClipShot as ClipShot
from blurmatte.background.shots import find_shots as find_shots
from blurmatte.background.shots import joined_shots as joined_shots
from blurmatte.background.shots import thumbnail as thumbnail
