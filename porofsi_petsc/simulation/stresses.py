"""Stresses and strains at probes: components of tensors, invariants of the effective stress."""

from collections.abc import Collection

import numpy as np

from ..quantities import TENSOR, TENSORS

DIAGONAL = [TENSOR.index(pair) for pair in ("xx", "yy", "zz")]


def stress_values(
    asked: Collection[str], stress: np.ndarray, strain: np.ndarray, p: np.ndarray
) -> dict[str, np.ndarray]:
    """Return what is asked for of some points, name -> (n,).

    stress, strain : effective stress σ_E [Pa] and strain [-], (n, 6) in the order of
    `quantities.TENSOR`; p : (n,) [Pa], of compressible grains α p.  total is σ_E - p I;
    mean_effective_stress p' = -tr σ_E/3, positive in compression; von_mises q = √(3/2 s:s), s the
    deviator; principal_1 >= principal_2 >= principal_3, positive in tension.
    """
    total = total_stress(stress, p)
    found: dict[str, np.ndarray] = {}
    for name, tensor in (("stress", stress), ("total", total), ("strain", strain)):
        found |= dict(zip(TENSORS[name], tensor.T, strict=True))
    found |= invariants(stress)
    return {name: found[name] for name in asked}


def total_stress(stress: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return σ_E - p I, (n, 6) [Pa], of effective stresses (n, 6) and what bears of the pressure,
    (n,).
    """
    total = stress.copy()
    total[:, DIAGONAL] -= p[:, None]
    return total


def invariants(stress: np.ndarray) -> dict[str, np.ndarray]:
    """Return `quantities.INVARIANTS` of effective stresses (n, 6), name -> (n,) [Pa]."""
    tensor = np.empty((len(stress), 3, 3))
    for number, pair in enumerate(TENSOR):
        i, j = ("xyz".index(axis) for axis in pair)
        tensor[:, i, j] = tensor[:, j, i] = stress[:, number]
    mean = np.einsum("nii->n", tensor) / 3
    deviator = tensor - mean[:, None, None] * np.eye(3)
    principal = np.linalg.eigvalsh(tensor)[:, ::-1]
    return {
        "mean_effective_stress": -mean,
        "von_mises": np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)),
    } | {f"principal_{i + 1}": principal[:, i] for i in range(3)}
