"""Motion through the frames of a clip: detections, tracks, 3-D positions and free fall."""
