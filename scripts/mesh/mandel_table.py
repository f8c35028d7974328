"""Write configs/tables/mandel_top.csv: the exact settlement of the plate of the scene `mandel` over
time.

A rigid plate is no boundary condition of the package: the scene prescribes how it moves, and is
judged by all else.
"""

from pathlib import Path

import command_line
import numpy as np

from porofsi_petsc.exact import Mandel

TABLE = Path(__file__).resolve().parents[2] / "configs" / "tables" / "mandel_top.csv"
SLAB = Mandel(
    force=1e4, half_width=1.0, lam=4e6, mu=6e6, diffusivity=1e-4 * 16e6 / 1e4
)  # the scene's material
HALF_HEIGHT = 0.5  # [m]
TIMES = np.geomspace(
    1e-4, 10.0, 231
)  # [s]: rows 5 % apart, linear between them to 1e-4 of the change


def table():
    """Return the rows t [s], u_y [m] of the upper plate: at rest at t = 0, then as under the sudden
    force.
    """
    moving = [(t, SLAB.displacement_y(HALF_HEIGHT, t)) for t in TIMES]
    return np.array([(0.0, 0.0), *moving])


if __name__ == "__main__":
    command_line.parser("mesh mandel_table", __doc__).parse_args()
    TABLE.parent.mkdir(exist_ok=True)
    np.savetxt(TABLE, table(), delimiter=",", header="t,u_y", comments="", fmt="%.12g")
