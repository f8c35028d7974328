"""Cost of a 3-D step over the number of unknowns and of ranks: time, memory, iterations; writes
docs/studies/scale_<case>.*

Every run is a fresh mpirun.  Without --unknowns the whole study of the case: sizes from 1e4 to 2e6
on two ranks, 5e5 on one, two and four, 25 000 unknowns per rank on one to eight, and a run of fifty
steps with 1e5.  Runs that the CSV has are not done again. With --unknowns (and --ranks, --steps,
--set) those runs alone, printed and not written.

Unknowns are displacement (of a free fluid's mesh too), velocity and pressure; auxiliary fields do
not count.  A run takes S steps (3) after its start with the scene's own options: first (all
matrices made) and later ones (the mean), without what is written. CPU: the largest of the ranks.
Assembly and residual: both phases again at the end, values only, the least of three. Memory:
largest resident size of every rank since it started (raw) and without that of Python with its
imports; after the start what is held, free memory given back to the system. Share of fifty steps:
mesh, partition, fields, checkpoints at the scene's intervals; from the measured times, and measured
where fifty steps are run. Triad: a = b + c over arrays of 32 MB on all ranks at once.
"""

import argparse
import ctypes
import gc
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import command_line
import launching
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ROOT / "docs" / "studies"
SIZES = (10_000, 30_000, 100_000, 200_000, 500_000, 1_000_000, 2_000_000)
FIXED = 500_000
FIXED_RANKS = (1, 2, 4)
WEAK = 25_000
WEAK_RANKS = (1, 2, 4, 8)
LONG = 100_000
LONG_STEPS = 50
STEPS = 3
LIMIT = 900  # of a run [s]
BUSY = os.getloadavg()[0]  # when this process began
REPEATS = 3  # of an assembly
MB, STREAM = 1e6, 4_000_000  # [bytes], doubles in each array of the triad


@dataclass(frozen=True)
class Case:
    """A scene and its mesh: overrides(unknowns) are the keys that give about so many; per_node
    unknowns of a node.

    scene : name of a shipped scene or a TOML file; intervals : steps between two fields and two
    checkpoints of a long run
    """

    scene: str
    overrides: object
    fields_every: int
    checkpoint_every: int
    fixed: tuple = field(default=("figures={}", "expect=[]"))

    def output(self, steps):
        """Return the key of what a run writes on its way: the first and the last state, a long one
        what it would.
        """
        if steps < LONG_STEPS:
            return f"output={{ fields_every = {steps} }}"
        return (
            f"output={{ fields_every = {self.fields_every}, checkpoint_every ="
            f" {self.checkpoint_every} }}"
        )


def block(unknowns):
    """Return the cells of a graded block of n x n x n with 7 unknowns to a node; two of eleven
    cells below the patch.
    """
    n = max(round((unknowns / 7) ** (1 / 3)) - 1, 3)
    fine = max(round(2 * n / 11), 1)
    return (
        f"mesh.x.cells=[{fine},{n - fine}]",
        f"mesh.y.cells=[{fine},{n - fine}]",
        f"mesh.z.cells=[{n}]",
    )


def channel(unknowns):
    """Return the cells of a channel of 2n x n x n with a block of n/4 x n/2 x n/2, 7 unknowns to a
    node of the fluid.
    """
    n = max(round((unknowns / 14) ** (1 / 3) - 0.83), 4)
    half = round(n / 2)
    quarter = round(n / 4)
    cells = (
        (half, quarter, 2 * n - half - quarter),
        (quarter, n - 2 * quarter, quarter),
        (half, n - half),
    )
    return tuple(
        f"mesh.{axis}.cells={list(numbers)}" for axis, numbers in zip("xyz", cells, strict=True)
    )


CASES = {
    "porous": Case("pulse3d", block, fields_every=5, checkpoint_every=25),
    "fsi": Case(
        str(ROOT / "tests" / "scenes" / "block_in_channel3d.toml"),
        channel,
        fields_every=5,
        checkpoint_every=25,
    ),
}


# -- one run, on every rank ------------------------------------------------------------------------


class Meter:
    """Wall and CPU time of named parts, and the resident memory after each, on one rank."""

    def __init__(self):
        """Note the memory of Python with its imports."""
        self.wall = {}
        self.cpu = {}
        self.resident = {}
        self.peak = {}
        self.note("start")

    def note(self, name):
        """Record largest and present resident memory [bytes], the latter after free memory was
        given back.
        """
        self.peak[name] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        gc.collect()
        _give_back()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        self.resident[name] = pages * resource.getpagesize()

    @contextmanager
    def part(self, name):
        """Measure a part."""
        wall = time.perf_counter()
        cpu = time.process_time()
        yield
        self.wall[name] = time.perf_counter() - wall
        self.cpu[name] = time.process_time() - cpu
        self.note(name)


def _give_back():
    """Give free memory back to the system, where its C library can."""
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except AttributeError:  # not of GNU
        pass


class StepTimes:
    """A callback of a simulation that notes the time of every step without the output."""

    def __init__(self, stopwatch):
        """Start the clock."""
        self._stopwatch = stopwatch
        self.wall = []
        self.cpu = []
        self._mark()

    def _mark(self):
        self._last = time.perf_counter(), time.process_time(), self._stopwatch.seconds["output"]

    def __call__(self, simulation):
        """Note the time since the step before."""
        wall, cpu, output = self._last
        self.wall.append(time.perf_counter() - wall - (self._stopwatch.seconds["output"] - output))
        self.cpu.append(time.process_time() - cpu)
        self._mark()


def work(case_name, unknowns, steps, changes, folder, holders):
    """Do one run on all ranks and return its record on rank 0 (collective)."""
    from porofsi_petsc import load_scene
    from porofsi_petsc.linalg import options

    case = CASES[case_name]
    scene = load_scene(
        case.scene, (*case.overrides(unknowns), *case.fixed, case.output(steps), *changes)
    )
    scene = scene.model_copy(
        update={"time": scene.time.model_copy(update={"end": steps * scene.time.step})}
    )
    options.start(scene.petsc.options)
    from mpi4py import MPI

    from porofsi_petsc.output.progress import Progress
    from porofsi_petsc.simulation.build import local_mesh
    from porofsi_petsc.simulation.records import Records
    from porofsi_petsc.simulation.simulation import Simulation

    comm = MPI.COMM_WORLD
    meter = Meter()
    with meter.part("mesh"):
        mesh = local_mesh(scene, comm)
    with meter.part("build"):
        simulation = Simulation(scene, comm, mesh=mesh)
        records = Records(simulation, Path(folder))
        records.progress = Progress(scene.time.end, quiet=True)
    coupling = simulation.coupling
    loop = simulation.loop
    seconds = simulation.stopwatch.seconds
    with meter.part("mesh_file"):
        records.open()
    with meter.part("fields"):
        records.start()
    times = StepTimes(simulation.stopwatch)
    with meter.part("steps"):
        simulation.run(callbacks=[records.after_step, times])
    with meter.part("checkpoint"):
        records.checkpoint()
    records.close()
    output = seconds["output"]
    repeated = _repeat(coupling, loop.clock.schemes(loop.model, scene.time.step)[1])
    everyone = comm.gather((meter, times, repeated, output))
    triad = _triad(comm)
    if holders:
        for rank in range(comm.size):
            if rank == comm.rank:
                print_holders(coupling, mesh.n_owned * (2 * mesh.dim + 1), rank)
            comm.barrier()
    return _record(mesh, coupling, loop, everyone, triad, case) if comm.rank == 0 else None


def _repeat(coupling, rates):
    """Return name -> least (wall, CPU) time of new tangents (values only) and of residuals at the
    accepted state (collective).
    """
    coupling.reset()
    fluid = coupling.fluid
    solid = coupling.solid
    comm = coupling.solid.mesh.comm
    actions = {
        "assembly": lambda: (
            fluid.renew_tangent(rates, coupling.mesh_state()),
            solid.renew_tangent(rates),
        ),
        "residual": lambda: solid.residual(coupling.flow(fluid.residual(coupling.mesh_state()))),
    }
    best = {}
    for name, action in actions.items():
        for _ in range(REPEATS):
            comm.barrier()
            wall = time.perf_counter()
            cpu = time.process_time()
            action()
            comm.barrier()
            taken = time.perf_counter() - wall, time.process_time() - cpu
            best[name] = min(best.get(name, taken), taken)
    return best


def _triad(comm):
    """Return the bytes per second of a = b + c on all ranks together (collective)."""
    a = np.zeros(STREAM)
    b = np.ones(STREAM)
    c = np.ones(STREAM)
    best = np.inf
    for _ in range(10):
        comm.barrier()
        start = time.perf_counter()
        np.add(b, c, out=a)
        comm.barrier()
        best = min(best, time.perf_counter() - start)
    return comm.size * 3 * a.nbytes / best


def _record(mesh, coupling, loop, everyone, triad, case):
    """Return the columns of a run from the measurements of all ranks."""
    meters, times, repeated, output = zip(*everyone, strict=True)
    unknowns = _unknowns(coupling)
    base = sum(meter.peak["start"] for meter in meters)
    started = [meter.resident["build"] - meter.resident["start"] for meter in meters]
    start_peak = [meter.peak["build"] - meter.peak["start"] for meter in meters]
    peak = sum(meter.peak["checkpoint"] for meter in meters)

    def wall(name):
        return max(meter.wall[name] for meter in meters)

    def steps(attribute, part):
        return max(float(np.mean(getattr(one, attribute)[part])) for one in times)

    later = slice(1, None) if loop.clock.step > 1 else slice(0, 1)
    first = steps("wall", slice(0, 1))
    other = steps("wall", later)
    start = wall("mesh") + wall("mesh_file")
    write = wall("fields")
    check = wall("checkpoint")
    writing = write * (1 + LONG_STEPS // case.fields_every) + check * (
        LONG_STEPS // case.checkpoint_every
    )
    total = start + wall("build") + first + (LONG_STEPS - 1) * other + writing
    share = (start + writing) / total
    if loop.clock.step >= LONG_STEPS:
        share = (start + max(output)) / sum(map(wall, meters[0].wall))
    record = {
        "elements": mesh.n_cells_global,
        "nodes": mesh.n_global,
        "true_unknowns": unknowns,
        "sweeps": _counts(loop.iterations),
    }
    for name in ("fluid", "solid", "mesh"):
        block = coupling.blocks.get(name)
        record[f"{name}_iterations"] = (
            _counts(block.solver.iterations) if block and block.solver else ""
        )
    return record | {
        "mesh_seconds": wall("mesh"),
        "build_seconds": wall("build"),
        "first_seconds": first,
        "first_cpu": steps("cpu", slice(0, 1)),
        "step_seconds": other,
        "step_cpu": steps("cpu", later),
        "first_us": 1e6 * first / unknowns,
        "step_us": 1e6 * other / unknowns,
        **{
            f"{name}_{unit}": max(one[name][i] for one in repeated)
            for name in ("assembly", "residual")
            for i, unit in enumerate(("seconds", "cpu"))
        },
        "fields_seconds": write,
        "checkpoint_seconds": check,
        "share": share,
        "base_mb": base / MB,
        "start_mb_least": min(started) / MB,
        "start_mb_largest": max(started) / MB,
        "start_peak_mb_largest": max(start_peak) / MB,
        "peak_mb": peak / MB,
        "peak_bytes_per_unknown": (peak - base) / unknowns,
        "raw_bytes_per_unknown": peak / unknowns,
        "triad_gb_s": triad / 1e9,
    }


def _unknowns(coupling):
    """Return the number of displacements, of the mesh of a free fluid too, velocities and
    pressures.
    """
    with_displacement = [coupling.solid, *([coupling.motion] if "mesh" in coupling.blocks else [])]
    d = coupling.solid.domain.dim
    displacements = sum(d * part.domain.n_nodes for part in with_displacement)
    return displacements + (d + 1) * coupling.fluid.domain.n_nodes


def _counts(iterations):
    """Return mean and largest as text."""
    return f"{np.mean(iterations):.1f}/{max(iterations)}" if len(iterations) else ""


def print_holders(thing, unknowns, rank):
    """Print which attributes of a coupling hold how many bytes of NumPy arrays per unknown of the
    rank, each array once.
    """
    seen = set()
    found = {}

    def visit(value, path, depth):
        if id(value) in seen or depth > 40:
            return
        seen.add(id(value))
        if isinstance(value, np.ndarray):
            owner = value
            while isinstance(owner.base, np.ndarray):
                owner = owner.base
            if owner is value or id(owner) not in seen:
                seen.add(id(owner))
                found[path] = found.get(path, 0) + owner.nbytes
        elif isinstance(value, dict):
            for key, item in value.items():
                visit(item, f"{path}.{key}", depth + 1)
        elif isinstance(value, list | tuple):
            for item in value:
                visit(item, path, depth + 1)
        elif type(value).__module__.startswith(("porofsi_petsc", "scipy")) and hasattr(
            value, "__dict__"
        ):
            visit(vars(value), path, depth + 1)

    visit(thing, "", 0)
    print(
        f"rank {rank}: bytes per unknown in arrays of the package,"
        f" {sum(found.values()) / unknowns:.0f} in all"
    )
    for path, size in sorted(found.items(), key=lambda item: -item[1]):
        if size > 5 * unknowns:
            print(f"  {size / unknowns:7.0f}  {path}")


# -- the study, on one process ---------------------------------------------------------------------

KEYS = ("unknowns", "ranks", "steps")
COLUMNS = (
    "elements nodes true_unknowns sweeps fluid_iterations solid_iterations mesh_iterations"
    " mesh_seconds build_seconds first_seconds first_cpu step_seconds step_cpu first_us step_us"
    " assembly_seconds assembly_cpu residual_seconds residual_cpu fields_seconds checkpoint_seconds"
    " share base_mb start_mb_least start_mb_largest start_peak_mb_largest peak_mb"
    " peak_bytes_per_unknown raw_bytes_per_unknown triad_gb_s"
).split()


@dataclass(frozen=True)
class Run:
    """One mpirun; `keys` and `label` are what `studies.table.sweep` asks for."""

    case: str
    unknowns: int
    ranks: int
    steps: int

    @property
    def keys(self):
        """Return the keys of the run in the table."""
        return {name: getattr(self, name) for name in KEYS}

    @property
    def label(self):
        """Return a short text."""
        return f"{self.case}, {self.unknowns} unknowns, {self.ranks} ranks, {self.steps} steps"


def study(case):
    """Return the runs of the whole study, small ones first."""
    pairs = [(size, 2, STEPS) for size in SIZES] + [(FIXED, ranks, STEPS) for ranks in FIXED_RANKS]
    pairs += [(WEAK * ranks, ranks, STEPS) for ranks in WEAK_RANKS] + [(LONG, 2, LONG_STEPS)]
    return [
        Run(case, *pair)
        for pair in sorted(set(pairs), key=lambda pair: (pair[0] * pair[2], pair[1]))
    ]


def execute(run, changes=(), holders=False):
    """Run in fresh processes and return the record; what goes wrong ends the study with the last
    lines of the error.
    """
    print(f"running {run.label}", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        order = {
            "case_name": run.case,
            "unknowns": run.unknowns,
            "steps": run.steps,
            "changes": list(changes),
        }
        order |= {"folder": folder, "holders": holders}
        mpirun = ["mpirun", "-n", str(run.ranks)]
        command = [
            *mpirun,
            sys.executable,
            "-m",
            "bench.scale",
            "--worker",
            json.dumps(order),
        ]
        streams = {"capture_output": True, "text": True}
        try:
            done = subprocess.run(command, **streams, timeout=LIMIT, env=launching.environment())
        except subprocess.TimeoutExpired:
            sys.exit(f"{run.label}: not done after {LIMIT} s; leave it out with --largest")
        result = Path(folder, "record.json")
        if done.returncode or not result.is_file():
            sys.exit(f"{run.label}: failed\n" + "\n".join(done.stderr.splitlines()[-20:]))
        if holders:
            print(done.stdout)
        return json.loads(result.read_text())


def worker(order):
    """Do what `execute` orders and leave the record in its folder."""
    sys.path.insert(0, str(ROOT))
    record = work(**order)
    if record:
        Path(order["folder"], "record.json").write_text(json.dumps(record))


RATIOS = {
    "assembly": "assembly",
    "residual": "residual",
    "first step": "first",
    "later step": "step",
}


def report(case, rows):
    """Write the tables of a study as markdown and its figure; rows : list of dicts of texts."""
    from porofsi_petsc.studies.table import markdown

    def of(size, ranks, steps=STEPS):
        wanted = {"unknowns": str(size), "ranks": str(ranks), "steps": str(steps)}
        return [row for row in rows if wanted.items() <= row.items()]

    def table(chosen, **columns):
        lines = [
            [row[column] if isinstance(column, str) else column(row) for column in columns.values()]
            for row in chosen
        ]
        return markdown([name.replace("_", " ") for name in columns], lines)

    growth = [row for size in SIZES for row in of(size, 2)]
    fixed = [row for ranks in FIXED_RANKS for row in of(FIXED, ranks)]
    one = fixed[0] if fixed else {}

    def faster(column):
        """Return a text: the time and how many times shorter it is than on one rank."""
        return lambda row: f"{row[column]} ({float(one[column]) / float(row[column]):.2f})"

    def bandwidth(row):
        return f"{row['triad_gb_s']} ({float(row['triad_gb_s']) / float(one['triad_gb_s']):.2f})"

    weak = [row for ranks in WEAK_RANKS for row in of(WEAK * ranks, ranks)]
    iterations = {"sweeps": "sweeps", "fluid": "fluid_iterations", "solid": "solid_iterations"}
    if any(row["mesh_iterations"] for row in rows):
        iterations["mesh"] = "mesh_iterations"
    parts = [
        f"# Growth of the case `{case}`\n\n"
        f"Written by `scripts/run bench scale {case}` (do not edit by "
        f"hand); what is measured: its `--help`. {versions()} {load()}\n",
        "## Sizes, two ranks\n",
        table(
            growth,
            unknowns="true_unknowns",
            **iterations,
            **{"first step, s": "first_seconds", "µs per unknown": "first_us"},
            **{
                "later step, s": "step_seconds",
                "µs per unknown ": "step_us",
                "peak, MB": "peak_mb",
            },
            **{"bytes per unknown": "peak_bytes_per_unknown", "raw": "raw_bytes_per_unknown"},
        ),
        "\n## Start and output, two ranks\n",
        table(
            growth + of(LONG, 2, LONG_STEPS),
            unknowns="true_unknowns",
            steps="steps",
            **{
                "mesh and partition, s": "mesh_seconds",
                "phases, s": "build_seconds",
                "fields, s": "fields_seconds",
            },
            **{"checkpoint, s": "checkpoint_seconds", "share of 50 steps": "share"},
        ),
        "\n## Ranks, the same unknowns\n",
        table(
            fixed,
            ranks="ranks",
            **iterations,
            **{f"{name}, s (ratio)": faster(f"{key}_seconds") for name, key in RATIOS.items()},
            **{
                "triad, GB/s (ratio)": bandwidth,
                "after start, MB per rank": _span,
                "largest peak": "start_peak_mb_largest",
            },
        ),
        "\n## Ranks, the same unknowns on each\n",
        table(weak, ranks="ranks", unknowns="true_unknowns", **iterations),
    ]
    (STUDIES / f"scale_{case}.md").write_text("\n".join(parts) + "\n", encoding="utf-8")
    draw(case, growth)


def _span(row):
    return f"{row['start_mb_least']} to {row['start_mb_largest']}"


def versions():
    """Return a sentence about machine and versions."""
    from porofsi_petsc.linalg import options

    options.start()
    import numba
    from petsc4py import PETSc

    model = [
        line
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    cores = os.cpu_count()
    name = model[0].partition(":")[2].strip() if model else platform.machine()
    return (
        f"PETSc {petsc}, NumPy {np.__version__}, Numba {numba.__version__}, Python"
        f" {platform.python_version()}; {cores} cores of {name}."
    )


def load():
    """Return a sentence about what else ran before the first run."""
    verdict = (
        ": other programs had a part of the cores, so that the times are no measure"
        if BUSY > 1.5
        else ""
    )
    return f"Load before it began {BUSY:.1f}{verdict}."


def draw(case, rows):
    """Draw seconds and bytes over unknowns."""
    from matplotlib.figure import Figure

    x = np.array([float(row["true_unknowns"]) for row in rows])
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, label, marker in (
        ("first_seconds", "first step", "o"),
        ("step_seconds", "later step", "s"),
    ):
        left.loglog(
            x, [float(row[name]) for row in rows], marker + "-", label=label, fillstyle="none"
        )
    left.loglog(x, float(rows[-1]["step_seconds"]) * x / x[-1], ":", color="0.5", label="linear")
    left.set_ylabel("wall time on two ranks [s]")
    right.loglog(
        x,
        [float(row["peak_mb"]) - float(row["base_mb"]) for row in rows],
        "o-",
        label="peak",
        fillstyle="none",
    )
    right.loglog(x, 6e3 * x / MB, ":", color="0.5", label="6 kB per unknown")
    right.set_ylabel("memory of both ranks [MB]")
    for ax in (left, right):
        ax.set_xlabel("unknowns")
        ax.grid(color="0.9", which="both", linewidth=0.5)
        ax.legend()
    figure.savefig(STUDIES / f"scale_{case}.png", dpi=120)


def main():
    """Run what the command line asks for."""
    parser = command_line.parser("bench scale", __doc__)
    parser.add_argument("case", nargs="?", choices=CASES, metavar="CASE", help=", ".join(CASES))
    parser.add_argument(
        "--unknowns",
        type=lambda text: int(float(text)),
        nargs="+",
        help="these sizes, nothing is written",
    )
    parser.add_argument("--ranks", type=int, nargs="+", default=[2])
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change of the scene"
    )
    parser.add_argument("--again", action="store_true", help="all runs anew")
    parser.add_argument(
        "--largest",
        type=lambda text: int(float(text)),
        default=SIZES[-1],
        help="leave larger sizes out",
    )
    parser.add_argument("--json", action="store_true")
    parser.add_argument(
        "--holders",
        action="store_true",
        help="print who holds how many bytes per unknown on every rank",
    )
    parser.add_argument("--worker", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        return worker(options.worker)
    if not options.case:
        parser.error("no case")
    sys.path.insert(0, str(ROOT))
    if options.unknowns:
        runs = [
            Run(options.case, size, ranks, options.steps)
            for size in options.unknowns
            for ranks in options.ranks
        ]
        records = []
        for run in runs:
            records.append(run.keys | execute(run, options.set, options.holders))
            if not options.json:
                print(
                    run.label,
                    *(f"  {name:24s} {value}" for name, value in records[-1].items()),
                    sep="\n",
                    flush=True,
                )
    else:
        from porofsi_petsc.studies.table import Table, sweep

        execute(Run(options.case, 2000, 1, 1))  # compiled loops are in the cache from here on
        table = Table(STUDIES / f"scale_{options.case}.csv", KEYS, COLUMNS, options.again)
        records = sweep(
            table, [run for run in study(options.case) if run.unknowns <= options.largest], execute
        )
        report(options.case, records)
    if options.json:
        print(json.dumps(records, indent=1))


if __name__ == "__main__":
    main()
