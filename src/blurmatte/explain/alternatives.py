"""Other colors that fit a streak, with their alpha; and the interval of the common factor."""

from blurmatte.matting.alternatives import Alternative
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution


def alternatives_of(solution: Solution) -> list[Alternative]:
    """The hypotheses of `stats["alternatives"]`, the answer's own first.

    None if the grade is confirmed, or if none were compared.
    """
    if solution.grade is Grade.CONFIRMED or "grade" not in solution.stats:
        return []
    return [Alternative(**one) for one in solution.stats.get("alternatives", ())]


def alternatives_in_words(solution: Solution) -> list[str]:
    """Alternatives, and the interval of the common factor of alpha; both without a full stop."""
    return [*also_fits(solution), *factor_interval(solution)]


def also_fits(solution: Solution) -> list[str]:
    """Colors of the hypotheses whose alpha differs from the answer's; one line or none."""
    others = [one for one in alternatives_of(solution)[1:] if one.disagrees]
    parts = (
        ("also fits", [_with_alpha(one) for one in others if one.matters]),
        ("fits less well", [_with_alpha(one) for one in others if not one.matters]),
    )
    said = [f"{heading}: {'; '.join(those)}" for heading, those in parts if those]
    return ["; ".join(said)] if said else []


def factor_interval(solution: Solution) -> list[str]:
    """The interval of a factor of all of alpha; one line or none.

    By one standard deviation of the calibrated error, and over the hypotheses.
    """
    found = alternatives_of(solution)
    std = solution.stats.get("alpha_scale_std", 0.0)
    ends = [(max(1 - std, 0.0), 1 + std, "by one standard deviation")] if std > 0 else []
    if len(found) > 1:
        factors = [1.0, *(one.alpha_factor for one in found)]
        ends.append((min(factors), max(factors), "over the hypotheses"))
    if not (found and ends):
        return []
    low, high = min(low for low, _, _ in ends), max(high for _, high, _ in ends)
    each = ", ".join(f"{low:.2f} to {high:.2f} {by}" for low, high, by in ends)
    return [f"all of alpha may be {low:.2f} to {high:.2f} times as large: {each}"]


def _with_alpha(one: Alternative) -> str:
    return f"{one.hex} with alpha x {one.alpha_factor:.2f} ({one.name})"
