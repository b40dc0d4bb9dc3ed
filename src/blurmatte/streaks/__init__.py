"""Streaks: regions of an image in which something moved against its plate."""

from blurmatte.streaks.evidence import shift_variance as shift_variance
from blurmatte.streaks.find import find_streak_within as find_streak_within
from blurmatte.streaks.find import find_streaks as find_streaks
from blurmatte.streaks.find import merge_across_occluder as merge_across_occluder
from blurmatte.streaks.find import require_streaks as require_streaks
from blurmatte.streaks.find import without_faint as without_faint
from blurmatte.streaks.gate import Gate as Gate
from blurmatte.streaks.streak import Streak as Streak
from blurmatte.streaks.streak import check_streak as check_streak
from blurmatte.streaks.streak import dilated as dilated
from blurmatte.streaks.streak import grown_part as grown_part
from blurmatte.streaks.streak import opened as opened
