"""Directions of anisotropic laws, in the coordinates of the reference configuration."""

import numpy as np

SAME = 1e-9  # of components of unit vectors


def unit(name: str, axis: tuple[float, ...]) -> np.ndarray:
    """Return a direction of length one, (3,): x, y, z, in the plane z across it, around an axis r,
    z, θ; raise ValueError where it is none.
    """
    length = np.linalg.norm(axis)
    if len(axis) != 3 or not length:
        raise ValueError(
            f"{name}: received {list(axis)}, expected three components, not all 0 (x, y, z; around"
            " an axis r, z, θ)"
        )
    return np.array(axis) / length


def mirrored(axes: tuple[np.ndarray, ...]) -> bool:
    """Return whether the directions (3,) are, up to their signs, their mirror images in the plane
    of the first two coordinates: only then a load in the plane moves nothing out of it.
    """
    images = [axis * (1, 1, -1) for axis in axes]
    return all(any(abs(abs(image @ axis) - 1) < SAME for axis in axes) for image in images)
