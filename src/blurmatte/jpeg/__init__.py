"""Quantized DCT coefficients of JPEG files: read, replaced block by block, and written losslessly."""
