"""What can be explained."""

import pytest

from blurmatte.explain import explain


def test_other_things_are_refused():
    with pytest.raises(TypeError, match="got int"):
        explain(3)
