"""Write a quarter of a thick tube as an input file of Abaqus without any set: sides get their names
in the scene.
"""

from pathlib import Path

import command_line
import numpy as np

INNER, OUTER = 0.1, 0.4  # radii [m]
CELLS = (8, 6)  # along the radius, over the quarter


def nodes_and_cells():
    """Return points (N, 2) [m] and the nodes of quadratic cells, (E, 8), counted from 1."""
    n, m = (2 * count for count in CELLS)
    r = INNER * (OUTER / INNER) ** (np.arange(n + 1) / n)
    r[1::2] = (r[:-2:2] + r[2::2]) / 2
    angle = np.pi / 2 * np.arange(m + 1) / m
    points, number = [], {}
    for j in range(m + 1):
        for i in range(n + 1):
            if i % 2 == 0 or j % 2 == 0:
                number[i, j] = len(points) + 1
                points.append((r[i] * np.cos(angle[j]), r[i] * np.sin(angle[j])))
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    cells = [
        [number[i + a, j + b] for a, b in around] for j in range(0, m, 2) for i in range(0, n, 2)
    ]
    return points, cells


def main():
    """Write the file that the command line asks for."""
    parser = command_line.parser("mesh thick_tube", __doc__)
    parser.add_argument("--output", type=Path, required=True, help="input file (.inp)")
    path = parser.parse_args().output
    points, cells = nodes_and_cells()
    lines = ["*Heading", "*Node"]
    lines += [f"{i}, {x:.12g}, {y:.12g}" for i, (x, y) in enumerate(points, start=1)]
    lines += ["*Element, type=CPE8"]
    lines += [", ".join(map(str, (e, *nodes))) for e, nodes in enumerate(cells, start=1)]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
