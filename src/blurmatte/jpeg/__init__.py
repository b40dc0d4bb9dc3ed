"""Quantized DCT coefficients of JPEG files: read, replaced block by block, and written losslessly."""

from blurmatte.jpeg.coding import compression_of as compression_of
from blurmatte.jpeg.coding import jpeg_bytes as jpeg_bytes
from blurmatte.jpeg.coding import read_jpeg as read_jpeg
from blurmatte.jpeg.coding import replace_blocks as replace_blocks
from blurmatte.jpeg.structure import Jpeg as Jpeg
from blurmatte.jpeg.structure import JpegError as JpegError
from blurmatte.jpeg.structure import check_header as check_header
from blurmatte.jpeg.structure import metadata_segments as metadata_segments
