"""Sheets and charts of results: pictures, numbers and warnings."""

from blurmatte.overview.calibration_charts import draw_noise as draw_noise
from blurmatte.overview.calibration_charts import draw_response as draw_response
from blurmatte.overview.clip import draw_clip as draw_clip
from blurmatte.overview.edit import draw_edit as draw_edit
from blurmatte.overview.edit import draw_exposures as draw_exposures
from blurmatte.overview.edit import draw_look as draw_look
from blurmatte.overview.motion import draw_motion as draw_motion
from blurmatte.overview.plate import draw_plate as draw_plate
from blurmatte.overview.solution import draw_overview as draw_overview
from blurmatte.overview.solution import sure_pixels as sure_pixels
