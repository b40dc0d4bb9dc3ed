"""explain: which objects it accepts."""

import pytest

from blurmatte.explain import explain


def test_rejects_other_types():
    with pytest.raises(TypeError, match="got int"):
        explain(3)
