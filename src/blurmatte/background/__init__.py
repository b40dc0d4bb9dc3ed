"""The plate: made of many frames, and matched to the moment of an image."""

from blurmatte.background.fit_match import Matching as Matching
from blurmatte.background.fit_match import agreement as agreement
from blurmatte.background.fit_match import fit_match as fit_match
from blurmatte.background.fit_match import match_plate as match_plate
from blurmatte.background.guess import PlateGuess as PlateGuess
from blurmatte.background.guess import guess_plate as guess_plate
from blurmatte.background.match import Match as Match
from blurmatte.background.plate import PlateFit as PlateFit
from blurmatte.background.plate import make_plate as make_plate
from blurmatte.background.plate import plate_for_clip as plate_for_clip
from blurmatte.background.samples import max_coded_samples as max_coded_samples
from blurmatte.background.shots import ClipShot as ClipShot
from blurmatte.background.shots import find_shots as find_shots
from blurmatte.background.shots import thumbnail as thumbnail
from blurmatte.background.stand_out import regions_that_stand_out as regions_that_stand_out
