"""PETSc Python preconditioner of the pressure block of a free fluid: pressure
convection-diffusion.
"""

import numpy as np
from petsc4py import PETSc


class PressureConvectionDiffusion:
    """Precondition the Schur complement of the pressure by S⁻¹ ≈ (1 + L⁻¹ T) Q⁻¹ (derivation:
    `kernels.pressure`).

    The inverses are KSPs of their own with a fixed linear operator, a multigrid cycle by default,
    with the options `<prefix of the block>compliance_` (Q) and `<prefix of the block>laplacian_`
    (L).  The matrices are the caller's, given to `replace` before every set-up and not freed here.
    The matrix scaled to a unit diagonal asks for D^½ S⁻¹ D^½, D the diagonal of the pressure's
    block.
    """

    def __init__(self) -> None:
        """Start without operators."""
        self._parts: tuple[PETSc.Object, ...] = ()

    def replace(
        self,
        compliance: PETSc.Mat,
        laplacian: PETSc.Mat,
        transport: PETSc.Mat,
        diagonal: np.ndarray,
    ) -> None:
        """Take Q, L, T (PETSc.Mat) and the diagonal of the pressure's block of the unscaled matrix,
        (owned rows,).
        """
        self._compliance = compliance
        self._laplacian = laplacian
        self._transport = transport
        self._diagonal = diagonal

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up the inner solvers and find the scaling from the diagonal of the block
        (collective).
        """
        self.destroy(pc)
        prefix = pc.getOptionsPrefix() or ""
        self._Q = _solver(self._compliance, prefix + "compliance_")
        self._L = _solver(self._laplacian, prefix + "laplacian_")
        self._scale = pc.getOperators()[1].getDiagonal()
        with self._scale as scale:
            scale[:] = (self._diagonal / scale) ** 0.5
        self._x, self._y, self._z = (self._scale.duplicate() for _ in range(3))
        self._parts = self._Q, self._L, self._scale, self._x, self._y, self._z

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to D^½ (1 + L⁻¹ T) Q⁻¹ D^½ x."""
        self._x.pointwiseMult(self._scale, x)
        self._Q.solve(self._x, self._y)
        self._transport.mult(self._y, self._z)
        self._L.solve(self._z, self._x)
        self._y.axpy(1.0, self._x)
        y.pointwiseMult(self._scale, self._y)

    def destroy(self, pc: PETSc.PC) -> None:
        """Free the inner solvers (collective)."""
        for part in self._parts:
            part.destroy()
        self._parts = ()


def _solver(matrix, prefix):
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    ksp.setFromOptions()
    ksp.setUp()
    return ksp
