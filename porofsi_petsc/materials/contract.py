"""What the rest of the package takes for granted of a law, looked at when one is registered."""

import numpy as np

from ..registry import examples

LAM, MU, N_S = 1.7, 0.8, 0.4
STRAIN = 0.02  # of the states that are looked at: far from what a law may refuse
STEP = 1e-5  # of differences
# Errors of differences are of STEP² and 1e-16/STEP; a law that is wrong is off by parts of it.
SMALL = 1e-6


def check_elastic(law: type) -> None:
    """Raise ValueError where an elastic law breaks its contract in two or three dimensions.

    At rest no stress and the tangent of λ and μ, of an anisotropic law moduli between those that it
    gives; the stress is the slope of the energy and turns
    with the body; the tangent is the slope of the stress.
    """
    body = law(LAM, MU, N_S, **examples(law))
    for d in (2, 3):
        H = STRAIN * np.random.default_rng(d).standard_normal((4, d, d))
        with np.errstate(all="ignore"):
            _check_at_rest(body, d)
            P = _finite(body.stress(H), H.shape, "stress")
            _require(P, _slope(body.energy, H, ()), "the stress is not the slope of the energy")
            A = _finite(body.tangent(H), H.shape + (d, d), "tangent")
            _require(A, _slope(body.stress, H, (d, d)), "the tangent is not that of the stress")
            if not body.small_strain:
                _check_objective(body, H, P)


def check_permeability(law: type) -> None:
    """Raise ValueError unless a law gives k/k0 = 1 at J = 1 and takes complex volume ratios."""
    body = law(**examples(law))
    J = np.array([1.0, 0.9, 1.1])
    factor = _finite(body.factor(J, N_S), J.shape, "factor")
    if abs(factor[0] - 1) > SMALL:
        raise ValueError(f"k/k0 = {factor[0]:g} at J = 1, expected 1")
    slope = np.imag(body.factor(J + 1e-30j, N_S)) / 1e-30
    difference = (body.factor(J + STEP, N_S) - body.factor(J - STEP, N_S)) / (2 * STEP)
    _require(slope, difference, "the factor of complex J is not that of real J")


def _check_at_rest(body, d):
    rest = np.zeros((1, d, d))
    stress = _finite(body.stress(rest), rest.shape, "stress")
    if np.abs(stress).max() > SMALL * MU:
        raise ValueError(f"a stress of {np.abs(stress).max():.3g} at rest, expected none")
    found = _finite(body.tangent(rest), (1, d, d, d, d), "tangent")[0]
    if body.anisotropic:
        _check_moduli(body, d)
        return
    I = np.eye(d)  # noqa: E741
    expected = LAM * np.einsum("iJ,kL->iJkL", I, I)
    expected += MU * (np.einsum("ik,JL->iJkL", I, I) + np.einsum("iL,kJ->iJkL", I, I))
    _require(found, expected, f"the tangent at rest is not that of λ = {LAM:g} and μ = {MU:g}")


def _check_moduli(body, d):
    """Look at the moduli of compressions and stretches along many directions, small ones."""
    n = np.random.default_rng(d).standard_normal((200, d))
    n /= np.linalg.norm(n, axis=1)[:, None]
    for strain in (-STEP, STEP):
        A = body.tangent(strain * n[:, :, None] * n[:, None, :])
        moduli = np.einsum("pi,pJ,pk,pL,piJkL->p", n, n, n, n, A)
        slack = 100 * STEP * MU
        if moduli.min() < body.softest_modulus - slack:
            raise ValueError(f"a modulus of {moduli.min():.3g}, less than the softest_modulus")
        if moduli.max() > body.oedometer_modulus + slack:
            raise ValueError(f"a modulus of {moduli.max():.3g}, more than the oedometer_modulus")


def _check_objective(body, H, P):
    d = H.shape[-1]
    I = np.eye(d)  # noqa: E741
    Q = np.linalg.qr(np.random.default_rng(9).standard_normal((d, d)))[0]
    Q[:, 0] *= np.sign(np.linalg.det(Q))
    _require(body.stress(Q @ (H + I) - I), Q @ P, "the stress does not turn with the body")


def _slope(function, H, shape):
    """Return the central differences of a function by H, (n, d, d) + shape with H's indices last
    where the function has some.
    """
    d = H.shape[-1]
    columns = []
    for i, J in np.ndindex(d, d):
        step = np.zeros((d, d))
        step[i, J] = STEP
        columns.append((function(H + step) - function(H - step)) / (2 * STEP))
    return np.stack(columns, axis=-1).reshape(*H.shape[:1], *shape, d, d)


def _finite(values, shape, what):
    values = np.asarray(values)
    if values.dtype.kind != "f" or values.shape != shape:
        received = f"a {what} of {values.dtype} of shape {values.shape}"
        raise ValueError(f"{received}, expected real numbers of shape {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"a {what} that is not finite at a strain of {STRAIN:g}")
    return values


def _require(found, expected, sentence):
    if not np.abs(found - expected).max() <= SMALL * max(np.abs(expected).max(), MU):
        raise ValueError(sentence)
