"""The innermost loop of the compiled routines: what a point adds to the vectors and matrices of its
element.
"""

import numpy as np

from ..compiled import inlined


@inlined
def add_point(
    A: int,
    d: int,
    size: int,
    N: np.ndarray,
    q: int,
    g: np.ndarray,
    D: np.ndarray,
    e: int,
    out: np.ndarray,
) -> None:
    """Add N_a D_0z + ∂_j N_a D_jz to out (E, A, >= size) of element e, for N (Q, A), gradients g
    (A, d) and D (1 + d, size).

    The columns z are terms of a residual, or rows times unknowns of a tangent: one long contiguous
    loop.  Around an axis d counts the third direction, whose gradient N/r is that of radial
    components alone: D_dz is 0 in the columns of others.
    """
    for a in range(A):
        n = N[q, a]
        if d == 2:
            for z in range(size):
                out[e, a, z] += n * D[0, z] + g[a, 0] * D[1, z] + g[a, 1] * D[2, z]
        else:
            for z in range(size):
                out[e, a, z] += (
                    n * D[0, z] + g[a, 0] * D[1, z] + g[a, 1] * D[2, z] + g[a, 2] * D[3, z]
                )
