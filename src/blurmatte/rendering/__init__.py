"""Synthetic motion blur with a known answer: what tests, examples and benchmarks are made of."""

from blurmatte.rendering.ball import Ball as Ball
from blurmatte.rendering.camera import add_noise as add_noise
from blurmatte.rendering.camera import encode_codes as encode_codes
from blurmatte.rendering.camera import photograph as photograph
from blurmatte.rendering.plates import colorful_plate as colorful_plate
from blurmatte.rendering.plates import plain_plate as plain_plate
from blurmatte.rendering.plates import two_hue_plate as two_hue_plate
from blurmatte.rendering.scene import Body as Body
from blurmatte.rendering.scene import Rendering as Rendering
from blurmatte.rendering.scene import Scene as Scene
from blurmatte.rendering.scene import render as render
from blurmatte.rendering.sheet import Sheet as Sheet
