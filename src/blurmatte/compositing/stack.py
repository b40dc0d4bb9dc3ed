"""Many layers as one: the whole way of an object through a clip, or one long exposure."""

from collections.abc import Iterable, Iterator
from functools import reduce

from blurmatte.checks import check_same_size
from blurmatte.layer import Layer, check_layer


def stack(layers: Iterable[Layer]) -> Layer:
    """Layers one over the other, the first lowest: all of them seen as plainly as each alone.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size, e.g. the layers of a clip in their order. Only one is held at a time.

    Returns
    -------
    Layer
        Over a background it is what the layers are, put over it one after another.

    Raises
    ------
    ValueError
        If there is none, or sizes differ.
    """
    return reduce(_above, _of_one_size(layers))


def long_exposure(layers: Iterable[Layer]) -> Layer:
    """Layers of one exposure each as the layer of one exposure that lasts as long as all together.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size and exposures of one length, one directly after the other. Only one is held at a
        time.

    Returns
    -------
    Layer
        Alpha and light are the means: the object is as faint as a slower shutter would make it.

    Raises
    ------
    ValueError
        If there is none, or sizes differ.
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
    """Both as one, as each would be put over a background."""
    through = 1 - layer.alpha
    alpha = layer.alpha + through * below.alpha
    return Layer(alpha, layer.premultiplied + through[..., None] * below.premultiplied)


def _of_one_size(layers: Iterable[Layer]) -> Iterator[Layer]:
    """The same layers; raises ValueError if there is none, or one of another size."""
    size = None
    for number, layer in enumerate(layers):
        check_layer(f"layer {number}", layer)
        size = size or layer.size
        check_same_size(f"layer {number}", layer.size, "the first", size)
        yield layer
    if size is None:
        raise ValueError("there are no layers; give one at least")
