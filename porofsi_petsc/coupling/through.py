"""A free fluid that flows through porous solids: block Gauss-Seidel over solid and fluid."""

from ..phases.coupling_data import MeshState
from .interface import InterfaceMedium
from .porous import PorousCoupling


class ThroughFlowCoupling(InterfaceMedium, PorousCoupling):
    """The sweeps of a porous medium, on a mesh of the fluid that follows the solid: the solid with
    the drag of a frozen velocity, the mesh, the fluid with the drag of the new one.
    """

    def _carried(self) -> MeshState:
        self.motion.follow(self.solid.end_displacement)
        return super()._carried()
