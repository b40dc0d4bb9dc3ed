"""Many layers as one: the whole way of an object through a clip, or one long exposure."""

from collections.abc import Iterable, Iterator

from blurmatte.checks import check_same_size
from blurmatte.layer import Layer


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
    whole = None
    for layer in _of_one_size(layers):
        if whole is None:
            whole = layer
            continue
        through = 1 - layer.alpha
        alpha = layer.alpha + through * whole.alpha
        whole = Layer(alpha, layer.premultiplied + through[..., None] * whole.premultiplied)
    return _some(whole)


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
    alpha = light = None
    count = 0
    for layer in _of_one_size(layers):
        count += 1
        if alpha is None or light is None:
            alpha, light = layer.alpha.astype(float), layer.premultiplied.astype(float)
            kind = layer.alpha.dtype
        else:
            alpha += layer.alpha
            light += layer.premultiplied
    if alpha is None or light is None:
        return _some(None)
    return Layer((alpha / count).astype(kind), (light / count).astype(kind))


def _of_one_size(layers: Iterable[Layer]) -> Iterator[Layer]:
    first = None
    for number, layer in enumerate(layers):
        first = first or layer.size
        check_same_size(f"layer {number}", layer.size, "the first", first)
        yield layer


def _some(whole: Layer | None) -> Layer:
    if whole is None:
        raise ValueError("there are no layers; give one at least")
    return whole
