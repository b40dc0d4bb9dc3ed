"""Numbers in sentences: to the digits that their errors leave."""

import numpy as np


def with_error(value: float, std: float) -> str:
    """Value and error, to two digits of the error."""
    if not np.isfinite(std) or std <= 0:
        return f"{value:.4g}"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    return f"{value:.{digits}f} ± {std:.{digits}f}"
