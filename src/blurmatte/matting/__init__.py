"""From image, plate and colors to alpha and color, each with its error."""

from blurmatte.matting.case import Answer as Answer
from blurmatte.matting.case import Case as Case
from blurmatte.matting.case import Solver as Solver
from blurmatte.matting.hypotheses import Averaged as Averaged
from blurmatte.matting.maps import PixelMaps as PixelMaps
from blurmatte.matting.maps import Quality as Quality
from blurmatte.matting.pixelwise import Pixelwise as Pixelwise
from blurmatte.matting.shaded import Shaded as Shaded
from blurmatte.matting.smooth import Smooth as Smooth
from blurmatte.matting.solve import solve as solve
from blurmatte.matting.stats import SolutionStats as SolutionStats
