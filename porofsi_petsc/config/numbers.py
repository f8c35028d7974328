"""The range of the numbers of a scene, wide enough for every quantity in SI units."""

# Products of seven such numbers, and the squares of products of three, are within double precision
# (1e-308 … 1e308), so that neither a coefficient nor a norm that is made of them vanishes or
# overflows.
SMALLEST = 1e-40
LARGEST = 1e40
RANGE = f"a size from {SMALLEST:g} to {LARGEST:g}"


def in_range(value: float) -> bool:
    """Return whether a number is zero, or of a size that formulas of several of them can be
    computed with.
    """
    return value == 0 or SMALLEST <= abs(value) <= LARGEST
