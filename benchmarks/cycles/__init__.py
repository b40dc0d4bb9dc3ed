"""Scenes of Blender Cycles: rendered, photographed, scored."""
