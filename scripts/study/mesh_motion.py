"""Bend the beam of the Hron-Turek channel and print the smallest volume ratio of the mesh by law
and stiffening.

The beam takes the shape of a clamped one under a uniform load, w = tip (s⁴ - 4 s³ + 6 s²)/3 over
its length, its cross sections turned with it: about that of FSI2, whose largest excursion is 83 mm.
"""

from pathlib import Path

import command_line
import numpy as np
from mpi4py import MPI

from porofsi_petsc import load_scene
from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.simulation.build import local_mesh
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation
from porofsi_petsc.studies.table import markdown

ROOT, AXIS, LENGTH = 0.25, 0.2, 0.35  # start, height and length of the beam [m]
LAWS = ("harmonic", "linear_elastic", "neo_hookean", "distortion")
EXPONENTS = (0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
PARTS = 8  # of the motion, for the law that is not linear


def bent(X, tip):
    """Return the displacement of the beam's points X (n, 2), (n, 2) [m]."""
    s = ((X[:, 0] - ROOT) / LENGTH).clip(0, 1)
    deflection = tip * (s**4 - 4 * s**3 + 6 * s**2) / 3
    angle = np.arctan(tip / LENGTH * (4 * s**3 - 12 * s**2 + 12 * s) / 3)
    offset = X[:, 1] - AXIS
    return np.column_stack([-offset * np.sin(angle), deflection + offset * (np.cos(angle) - 1)])


def smallest_ratio(options, tip):
    """Return the smallest volume ratio of the mesh under the bent beam, None where one is
    inverted.
    """
    scene = load_scene("hron_turek_fsi2", options)
    mesh = local_mesh(scene, MPI.COMM_WORLD)
    coupling = Simulation(scene, mesh=mesh).coupling
    schemes, _ = Clock(scene.time).next_schemes(scene.model)
    motion = coupling.motion
    try:
        for part in np.linspace(1 / PARTS, 1, PARTS):
            motion.begin_step(schemes[0], 0.0)
            motion.follow(bent(mesh.X, part * tip))
            motion.accept()
    except ConvergenceError:
        return None
    return motion.memory()["smallest_ratio"]


def main():
    """Print the table that the command line asks for."""
    parser = command_line.parser("study mesh_motion", __doc__)
    parser.add_argument(
        "--mesh", type=Path, help="of the channel; that of the scene hron_turek_fsi2 without"
    )
    parser.add_argument("--tip", type=float, default=0.083, help="deflection of the tip [m]")
    options = parser.parse_args()
    start()
    given = (f"mesh.path={options.mesh}",) if options.mesh else ()
    rows = []
    for law in LAWS:
        changes = [
            (*given, f"mesh_motion.law={law}", f"mesh_motion.stiffening={exponent}")
            for exponent in EXPONENTS
        ]
        ratios = [smallest_ratio(change, options.tip) for change in changes]
        rows.append([law, *("inverted" if ratio is None else f"{ratio:.2f}" for ratio in ratios)])
    print(markdown(["law", *(f"χ = {exponent:g}" for exponent in EXPONENTS)], rows))


if __name__ == "__main__":
    main()
