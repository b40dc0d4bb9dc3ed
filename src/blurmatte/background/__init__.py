"""The scene without the object: a plate at the place and in the light of the image."""

from blurmatte.background.match import Match as Match
from blurmatte.background.match import Matching as Matching
from blurmatte.background.match import agreement as agreement
from blurmatte.background.match import fit_match as fit_match
from blurmatte.background.match import match_plate as match_plate
