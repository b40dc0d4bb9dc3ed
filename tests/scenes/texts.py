"""Texts of scene files that several tests render."""

BALL = """
title = "A ball"
size = [48, 36]
seed = 1
[plate]
kind = "colorful"
tile = 9
[body]
kind = "ball"
radius = 5
color = "#ffb040"
[path]
kind = "line"
start = [12, 12]
end = [34, 22]
[camera]
code_std = 0.004
"""
