"""Write an eighth of a ball of radius 1 m (Cryer's sphere), or its section; needs no gmsh."""

from pathlib import Path

import command_line

from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.studies.bodies import sector


def main():
    """Write the mesh that the command line asks for."""
    parser = command_line.parser("mesh sphere", __doc__)
    parser.add_argument(
        "--cells", type=int, default=5, help="layers of elements between middle and surface"
    )
    parser.add_argument(
        "--dim", type=int, choices=(2, 3), default=3, help="2: the section beside the axis x = 0"
    )
    parser.add_argument("--order", type=int, choices=(1, 2), default=2)
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 2.2)")
    options = parser.parse_args()
    write_mesh(options.output, sector(options.cells, options.order, options.dim, radius=1.0))


if __name__ == "__main__":
    main()
