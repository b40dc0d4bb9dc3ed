"""Sheets and charts of results: pictures, numbers and warnings."""

from blurmatte.figures.calibration_charts import draw_noise as draw_noise
from blurmatte.figures.calibration_charts import draw_response as draw_response
from blurmatte.figures.clip import ClipPhysics as ClipPhysics
from blurmatte.figures.clip import draw_clip as draw_clip
from blurmatte.figures.layers import draw_edit as draw_edit
from blurmatte.figures.layers import draw_exposures as draw_exposures
from blurmatte.figures.layers import draw_look as draw_look
from blurmatte.figures.motion import draw_motion as draw_motion
from blurmatte.figures.motion import draw_sharp as draw_sharp
from blurmatte.figures.solution import draw_overview as draw_overview
from blurmatte.figures.solution import draw_plate as draw_plate
