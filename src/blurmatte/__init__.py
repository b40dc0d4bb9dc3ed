"""blurmatte: alpha and color of motion-blurred objects over a known background.

The public API, on one screen. Linear light in, linear light out; see each name's docstring.
"""

from blurmatte.background import Match as Match
from blurmatte.background import Matching as Matching
from blurmatte.background import fit_match as fit_match
from blurmatte.background import match_plate as match_plate
from blurmatte.color import ColorModel as ColorModel
from blurmatte.color import core_colors as core_colors
from blurmatte.color import pick_colors as pick_colors
from blurmatte.color import published_color_line as published_color_line
from blurmatte.compositing import cover as cover
from blurmatte.errors import BlurmatteError as BlurmatteError
from blurmatte.errors import BlurmatteWarning as BlurmatteWarning
from blurmatte.errors import ColorModelError as ColorModelError
from blurmatte.errors import FileError as FileError
from blurmatte.errors import MotionError as MotionError
from blurmatte.errors import PlateError as PlateError
from blurmatte.errors import PlateWarning as PlateWarning
from blurmatte.errors import TransferWarning as TransferWarning
from blurmatte.explain import explain as explain
from blurmatte.files import MAX_PIXELS as MAX_PIXELS
from blurmatte.files import read as read
from blurmatte.files import read_color_model as read_color_model
from blurmatte.files import read_layer as read_layer
from blurmatte.files import read_solution as read_solution
from blurmatte.files import write as write
from blurmatte.layer import Layer as Layer
from blurmatte.matting import PixelMaps as PixelMaps
from blurmatte.matting import Pixelwise as Pixelwise
from blurmatte.matting import Quality as Quality
from blurmatte.matting import Solution as Solution
from blurmatte.matting import Smooth as Smooth
from blurmatte.matting import Swept as Swept
from blurmatte.matting import solve as solve
from blurmatte.overview import draw_overview as draw_overview
from blurmatte.radiometry import LINEAR as LINEAR
from blurmatte.radiometry import REC709 as REC709
from blurmatte.radiometry import SRGB as SRGB
from blurmatte.radiometry import LinearImage as LinearImage
from blurmatte.radiometry import NoiseModel as NoiseModel
from blurmatte.radiometry import Transfer as Transfer
from blurmatte.radiometry import decode as decode
from blurmatte.radiometry import fit_noise as fit_noise
from blurmatte.radiometry import gamma as gamma
from blurmatte.radiometry import named_transfer as named_transfer
from blurmatte.rendering import Ball as Ball
from blurmatte.rendering import Camera as Camera
from blurmatte.rendering import Rendering as Rendering
from blurmatte.rendering import Scene as Scene
from blurmatte.rendering import Shot as Shot
from blurmatte.rendering import render as render
from blurmatte.results import save_results as save_results
from blurmatte.scenes import Score as Score
from blurmatte.scenes import find_scenes as find_scenes
from blurmatte.scenes import mean_score as mean_score
from blurmatte.scenes import read_answer as read_answer
from blurmatte.scenes import read_shots as read_shots
from blurmatte.scenes import read_truth as read_truth
from blurmatte.scenes import save_shot as save_shot
from blurmatte.scenes import scene_names as scene_names
from blurmatte.scenes import scene_text as scene_text
from blurmatte.scenes import scene_title as scene_title
from blurmatte.scenes import score as score
from blurmatte.scenes import score_table as score_table
from blurmatte.streaks import Streak as Streak
from blurmatte.streaks import find_streak_within as find_streak_within
from blurmatte.streaks import find_streaks as find_streaks
from blurmatte.sweep import Sweep as Sweep
from blurmatte.sweep import TransferFit as TransferFit
from blurmatte.sweep import fit_color as fit_color
from blurmatte.sweep import fit_sweep as fit_sweep
from blurmatte.sweep import fit_transfer as fit_transfer
from blurmatte.trajectory import Trajectory as Trajectory

__version__ = "0.1.0"
