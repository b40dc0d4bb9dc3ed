"""Diagnostics and weights of fitted sweeps, and the calibration of their errors."""
