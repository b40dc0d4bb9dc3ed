"""Frames of a camera in the hand, rendered from a scene that is three times finer than they are."""

import numpy as np
import scipy

from blurmatte.background.warp import PixelGrid, Warp, warped
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.trajectory import Trajectory

FINE = 3  # points of the scene along a pixel
NOISE = 0.004
STRAIGHT = np.zeros((2, 2))  # bends of a frame and of the scene


def fine_scene(size, seed=3, tile=40):
    """Light of a scene of `size` pixels, in points, as a lens shows it; pixels are beyond its limit."""
    points = colorful_plate(size, seed, tile=tile).repeat(FINE, axis=0).repeat(FINE, axis=1)
    return scipy.ndimage.gaussian_filter(points, (1.8, 1.8, 0))


def similarity(size, x=0.0, y=0.0, zoom=1.0, turn=0.0):
    """h of a frame of `size` whose center is displaced by (x, y) pixels."""
    c, s, half = zoom * np.cos(turn), zoom * np.sin(turn), max(size) / 2
    return np.array([c - 1, -s, x / half, s, c - 1, y / half, 0, 0])


def shown(points, size, h, lens=0.0, bends=STRAIGHT):
    """(h, w, 3) light of a frame: means over its pixels; the scene is centered."""
    fine = tuple(FINE * side for side in size)
    corner = tuple(-((n - m) // 2) for n, m in zip(points.shape[1::-1], fine, strict=True))
    how = Warp(h, fine, lens, PixelGrid(fine), PixelGrid(points.shape[1::-1], corner), bends)
    width, height = size
    return warped(points, how).reshape(height, FINE, width, FINE, -1).mean(axis=(1, 3))


def with_ball(plate, h, start, end, radius=8.0):
    """A frame with a ball that moves between two points of the reference frame, and its rendering."""
    size = plate.shape[1::-1]
    xy = Warp(h, size).inverse.points(np.linspace(start, end, 9))
    path = Trajectory(xy, np.linspace(0, 1, 9))
    return render(Scene(plate, path, Ball(radius, (0.85, 0.16, 0.05))), 40)


def noisy(light, seed):
    """A picture of a camera."""
    noise = np.random.default_rng(seed).normal(0, NOISE, light.shape)
    return LinearImage((light + noise).astype(np.float32))
