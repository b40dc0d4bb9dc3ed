"""blurmatte: alpha and color of motion-blurred objects over a known background.

The public API, on one screen.
"""
