"""OpacityPrior: what is known of the part of the light behind an object that it hides."""

from enum import StrEnum


class OpacityPrior(StrEnum):
    """What is known of an object's opacity before the picture is looked at.

    Examples
    --------
    >>> glass = bm.matting.Averaged(opacity=bm.sweep.OpacityPrior.ANY)
    >>> bm.solve(image, plate, solver=glass).grade
    <Grade.CONFIRMED: 'confirmed'>
    """

    USUAL = "usual"  #: most objects are solid: decisive evidence is necessary for another opacity
    SOLID = "solid"  #: it is known to be 1
    ANY = "any"  #: solid or not with even odds; if not, every opacity from 0 to 1 is as likely
