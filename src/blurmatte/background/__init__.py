"""The plate: made of many frames, and matched to the moment of an image."""

from blurmatte.background.burst import burst_plate as burst_plate
from blurmatte.background.fit_match import Matching as Matching
from blurmatte.background.fit_match import fit_match as fit_match
from blurmatte.background.guess import PlateGuess as PlateGuess
from blurmatte.background.guess import guess_plate as guess_plate
from blurmatte.background.match import Match as Match
from blurmatte.background.parallax import parallax_between as parallax_between
from blurmatte.background.plate import PlateFit as PlateFit
from blurmatte.background.registration import ParallaxRegion as ParallaxRegion
from blurmatte.background.shots import ClipShot as ClipShot
from blurmatte.background.stand_out import regions_that_stand_out as regions_that_stand_out
