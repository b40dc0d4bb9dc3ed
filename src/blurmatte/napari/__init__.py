"""blurmatte as a plugin of napari, which reads napari.yaml; napari itself is not needed."""
