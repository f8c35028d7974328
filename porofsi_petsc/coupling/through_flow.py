"""A free fluid that flows through porous solids: block Gauss-Seidel over solid and fluid."""

from ..phases.coupling_data import MeshState
from ..phases.residual import Residual
from .interface import InterfaceMedium
from .porous import DragSweep

# Guard of Aitken's factor: the error factors of the sweeps lie between 0 and 1, λ at most, for
# which the best constant factor is 2/(2 - λ).
GUARD = (0.6, 2.0)


class ThroughFlowCoupling(InterfaceMedium, DragSweep):
    """The sweeps of a porous medium on a mesh of the fluid that follows the solid: the solid under
    the drag of a frozen velocity and the force on its dense parts, the mesh, the fluid with the
    drag of the new v_s.

    Both tangents have the drag, S c_v and S.  Of a motion whose stiffness is k [N/m^4] the fluid
    hands on S/(S + a), a its inertia and viscosity, the solid S c_v/(S c_v + k): the error of a
    sweep falls by the product of both, slowly where the drag of a step is far above the stiffness
    of the skeleton, S c_v L² >> E_c.  There an accelerator is what converges, or the cap is reached
    and the step has failed.  The fixed-stress term of a porous medium alone does not help: the
    fluid that flows in pushes the skeleton by its pressure, and no total stress is kept.
    """

    def _slow(self, iteration: int) -> bool:
        """Return that slow sweeps call for no new tangents: the drag is what is slow, and an
        accelerator that starts anew forgets what it has learnt of it.
        """
        return False

    def _corrected_mesh(self, residual: Residual, momentum: Residual) -> MeshState:
        self.solid.correct(residual.total)
        self.motion.follow(self.solid.end_displacement)
        return self.mesh_state()
