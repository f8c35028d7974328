"""Time MUMPS against FieldSplit and GAMG on refined pulse scenes: one set-up and one solve of each
block (CPU seconds).

A line per refinement and solver: unknowns; set-up and solve of the fluid and of the solid; linear
and coupling iterations; the time of a step that keeps its tangents (all its solves) and of one that
makes them anew (set-ups too).  The last column divides the times of a step with new tangents by
those with MUMPS.

    scripts/run bench solvers pulse2d 1 4 8 16
"""

import time
from unittest import mock

import command_line
import numpy as np

from bench.some_steps import some_steps
from porofsi_petsc import load_scene
from porofsi_petsc.linalg.solver import LinearSolver
from porofsi_petsc.simulation import builder


def overrides(scene, order, refinement):
    """Return the changes that make the mesh: 18 r x 8 r cells in 2-D, 6 r x 6 r x 6 r in 3-D."""
    r = refinement
    cells = (
        [[8 * r, 2 * r, 8 * r], [8 * r]]
        if scene == "pulse2d"
        else [[r, 5 * r], [r, 5 * r], [6 * r]]
    )
    return [f"mesh.order={order}"] + [
        f"mesh.{axis}.cells={n}" for axis, n in zip("xyz", cells, strict=False)
    ]


class Timings:
    """CPU time of every solve, its set-up included, by prefix."""

    def __init__(self):
        """Start without any."""
        self.seconds = {"fluid_": [], "solid_": []}

    def __enter__(self):
        original, seconds = LinearSolver.solve, self.seconds
        self._original = original

        def solve(solver, rhs):
            start = time.process_time()
            x = original(solver, rhs)
            seconds[solver.prefix].append((solver.factorizations, time.process_time() - start))
            return x

        LinearSolver.solve = solve
        return self

    def __exit__(self, *error):
        LinearSolver.solve = self._original

    def split(self, prefix):
        """Return (set-up, solve): the median solve, and what the whole takes beyond it, over the
        number of set-ups.

        Not the first solve alone: with nothing to do it leaves the set-up of the inner solvers to
        the second.
        """
        set_ups, seconds = (
            self.seconds[prefix][-1][0],
            np.array([second for _, second in self.seconds[prefix]]),
        )
        solve = float(np.median(seconds))
        return max(float(seconds.sum() - len(seconds) * solve) / set_ups, 0.0), solve


def measure(scene, direct, steps):
    """Return (unknowns, set-up and solve of fluid and solid, linear iterations of both, mean
    coupling iterations).
    """
    with (
        mock.patch.object(builder, "is_direct", lambda mesh: direct),
        Timings() as timings,
        some_steps(scene, steps) as done,
    ):
        phases = done.coupling.fluid, done.coupling.solid
        iterations = [phase.block.solver.iterations_mean for phase in phases]
        unknowns = done.coupling.solid.mesh.n_global * done.coupling.fluid.components
        return (
            unknowns,
            timings.split("fluid_"),
            timings.split("solid_"),
            iterations,
            float(np.mean(done.sweeps)),
        )


def line(name, result, reference):
    """Print one line; reference : kept and renewed time of MUMPS, None for MUMPS itself."""
    unknowns, fluid, solid, iterations, sweeps = result
    kept = sweeps * (fluid[1] + solid[1])
    renewed = kept + fluid[0] + solid[0]
    times = " ".join(f"{t:8.3f}" for t in (*fluid, *solid))
    ratio = "" if reference is None else f"{kept / reference[0]:6.2f} {renewed / reference[1]:6.2f}"
    print(
        f"{name:10} {unknowns:8} {times} {iterations[0]:6.1f} {iterations[1]:5.1f}"
        f" {sweeps:6.1f} {kept:8.2f} {renewed:8.2f} {ratio}",
        flush=True,
    )
    return kept, renewed


def main():
    """Measure every refinement with both solvers."""
    parser = command_line.parser("bench solvers", __doc__)
    parser.add_argument("scene", choices=["pulse2d", "pulse3d"])
    parser.add_argument("order", type=int, choices=[1, 2])
    parser.add_argument("refinement", type=int, nargs="+")
    parser.add_argument("--steps", type=int, default=2)
    parser.add_argument(
        "--only", choices=["direct", "iterative"], help="one solver only, without ratios"
    )
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    heads = f"{'set-up':>8} {'solve':>8}"
    print(
        f"{'solver':10} {'unknowns':>8} {heads} {heads} {'fluid':>6} {'solid':>5}"
        f" {'sweeps':>6} {'kept':>8} {'renewed':>8}  ratios"
    )
    for refinement in given.refinement:
        scene, reference = (
            load_scene(
                given.scene, overrides(given.scene, given.order, refinement) + given.changes
            ),
            None,
        )
        if given.only != "iterative":
            reference = line("MUMPS", measure(scene, True, given.steps), None)
        if given.only != "direct":
            line("iterative", measure(scene, False, given.steps), reference)


if __name__ == "__main__":
    main()
