"""with_error: digits of a number and of its standard deviation."""

import pytest

from blurmatte.explain.numbers import with_error


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (3.14159, 0.012, "3.142 ± 0.012"),
        (271.8, 35.2, "272 ± 35"),
        (0.5, 0, "0.5"),
        (12.34567, float("inf"), "12.35"),
    ],
)
def test_std_has_two_digits_and_number_as_many_decimals(value, std, text):
    """Exact: without a standard deviation, the number has four digits."""
    assert with_error(value, std) == text
