"""Renderer of motion-blurred scenes with ground truth, for tests, examples and benchmarks."""

from blurmatte.rendering.ball import Ball as Ball
from blurmatte.rendering.camera import Camera as Camera
from blurmatte.rendering.plates import colorful_plate as colorful_plate
from blurmatte.rendering.render import Rendering as Rendering
from blurmatte.rendering.render import render as render
from blurmatte.rendering.scene import Scene as Scene
from blurmatte.rendering.shot import Shot as Shot
