"""Search for the sweeps that fit an observation, and statistics of their residuals."""
