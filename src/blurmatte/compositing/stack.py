"""Combine layers of a clip: one over another, or as one long exposure."""

from collections.abc import Iterable, Iterator
from functools import reduce

from blurmatte.checks import check_same_size
from blurmatte.layer import Layer, check_layer


def stack(layers: Iterable[Layer]) -> Layer:
    """Composite layers one over another, the first lowest.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size, e.g. the layers of a clip in order. Only one is in memory at a time.

    Returns
    -------
    Layer
        Equivalent to compositing the layers one after another.

    Raises
    ------
    ValueError
        If there are no layers, or sizes differ.
    """
    return reduce(_above, _of_one_size(layers))


def long_exposure(layers: Iterable[Layer]) -> Layer:
    """Combine layers of successive exposures into the layer of one long exposure.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size, from contiguous exposures of equal length. Only one is in memory at a time.

    Returns
    -------
    Layer
        Means of alpha and light, as with a slower shutter.

    Raises
    ------
    ValueError
        If there are no layers, or sizes differ.
    """
    row = _of_one_size(layers)
    first = next(row)
    alpha, light = first.alpha.astype(float), first.premultiplied.astype(float)
    count = 1
    for layer in row:
        count += 1
        alpha += layer.alpha
        light += layer.premultiplied
    kind = first.alpha.dtype
    return Layer((alpha / count).astype(kind), (light / count).astype(kind))


def _above(below: Layer, layer: Layer) -> Layer:
    """`layer` over `below`."""
    through = 1 - layer.alpha
    alpha = layer.alpha + through * below.alpha
    return Layer(alpha, layer.premultiplied + through[..., None] * below.premultiplied)


def _of_one_size(layers: Iterable[Layer]) -> Iterator[Layer]:
    """Yield the layers; raises ValueError if there are none or sizes differ."""
    size = None
    for number, layer in enumerate(layers):
        check_layer(f"layer {number}", layer)
        size = size or layer.size
        check_same_size(f"layer {number}", layer.size, "the first", size)
        yield layer
    if size is None:
        raise ValueError("there are no layers; give one at least")
