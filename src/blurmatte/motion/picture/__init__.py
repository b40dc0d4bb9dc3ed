"""Motion measured from one picture, in pixels and exposures; its speed in meters per second."""
