"""Reading and writing of all file formats: pictures, layers, solutions, models and calibrations."""

from blurmatte.files.frames import Frames as Frames
from blurmatte.files.frames import read_frames as read_frames
from blurmatte.files.frames import read_layers as read_layers
from blurmatte.files.frames import write_frames as write_frames
from blurmatte.files.inplace import write_changed as write_changed
from blurmatte.files.lenses import read_intrinsics as read_intrinsics
from blurmatte.files.models import path_to_mapping as path_to_mapping
from blurmatte.files.models import read_color_model as read_color_model
from blurmatte.files.models import read_noise as read_noise
from blurmatte.files.models import read_path as read_path
from blurmatte.files.models import read_transfer as read_transfer
from blurmatte.files.reading import read as read
from blurmatte.files.reading import read_layer as read_layer
from blurmatte.files.reading import read_mask as read_mask
from blurmatte.files.solutions import read_solution as read_solution
from blurmatte.files.writing import require_parquet as require_parquet
from blurmatte.files.writing import write as write
from blurmatte.files.writing import write_together as write_together
