"""Hostile scene files and overrides: every one must be valid or be refused in one sentence.

A case is a shipped scene on a small mesh with one to three mutations of its tables, its text or its
overrides.  It is loaded, and if it is valid, checked as `porofsi check` does and with --steps N run
for N steps.  Each line of an InputError must be a sentence of at most 500 characters that names the
file, the key, the expression or the override; every other exception, and a minute without an
answer, is a finding. Prints the counts and the findings (their input goes to DIR) and ends with 1
when there is one.  A case is made from its number and the seed alone: --first N --cases 1 tries
case N again.
"""

import collections
import contextlib
import importlib
import io
import os
import random
import re
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from unittest import mock

import command_line
import tomli_w

from porofsi_petsc.config import list_scenes, load_scene
from porofsi_petsc.config.toml import read_toml
from porofsi_petsc.errors import InputError, PorofsiError

LONGEST_SENTENCE, TIME_LIMIT = 500, 60.0  # characters; seconds
PLACE = re.compile(
    r"DIR|/|\[|override |expression |scene "
)  # with which a sentence says where it belongs
# cells of a mesh that is made, and of one that no memory holds; between them is nothing to try
FEW = 5000
MANY = 1e12
NUMBERS = [0, 0.0, -0.0, -1, 1, 2, 0.5, 0.1 + 0.2, 1 - 1e-16, 1 + 2e-16, -1e308, 10**400]
NUMBERS += [5e-324, 1e-300, 1e-160, 1e-100, 1e-40, 1e-17, 1e-16, 1e16, 1e40, 1e41, 1e160, 1e308]
NUMBERS += [float("inf"), float("-inf"), float("nan"), 2**31, 2**63, 2**64, 10**30, 10**308]
WORDS = ["", " ", "auto", "report", "none", "x", "all", "top", "é", "日本", "a.b", "a\nb", "\x00"]
WORDS += ["\u202e", "'", '"', "{}", "%s", "#", "t", "a" * 300, "a" * 100_000]
WORDS += ["/dev/zero", "/dev/null", "/", "..", "no\x00file"]
ATOMS = ["t", "x", "y", "z", "pi", "e", "1", "0", "2.5", "1e308", "1e-308", "1e309", "9" * 320]
ATOMS += ["q", "''", "None", "True", "1j", "x.real"]
CALLS = [
    "sin",
    "exp",
    "log",
    "sqrt",
    "abs",
    "erf",
    "heaviside",
    "minimum",
    "maximum",
    "where",
    "eval",
    "t",
]
CHOICES = {
    "scheme": [
        "partitioned",
        "quasi_direct",
        "direct",
        "weak",
        "one_way",
        "generalized_alpha",
        "backward_euler",
        "steady",
    ],
    "accelerator": ["aitken", "none", "constant", "anderson", "iqn_ils", "auto"],
    "interface": ["dirichlet_neumann", "robin_neumann", "robin_robin", "neumann_dirichlet"],
    "law": [
        "linear_elastic",
        "saint_venant_kirchhoff",
        "neo_hookean",
        "neo_hookean_j2",
        "xie_leo",
        "ehlers_eipper",
        "harmonic",
    ],
    "split": ["corrected", "plain"],
    "tangent": ["lagged", "newton"],
    "on_failure": ["stop", "cut_step"],
    "order": [1, 2],
    "diagonal": ["left", "right", "alternating"],
    "porosity": ["constant", "variable", "auto", 0.5, 1e-6, 0.999999],
    "solution": [
        "column_step",
        "column_harmonic",
        "terzaghi",
        "mandel",
        "strip_footing",
        "xie_leo",
        "selfweight",
        "drained",
    ],
}
ACTIONS = (
    "value",
    "value",
    "value",
    "formula",
    "drop",
    "rename",
    "copy",
    "type",
    "nest",
    "table",
    "double",
)
SWITCHES = ("solid_inertia", "fluid_inertia", "convection", "viscosity", "moving_mesh")
SIGNS = [
    "+",
    "-",
    "*",
    "/",
    "%",
    "**",
    "//",
    "<",
    "<=",
    ">",
    "==",
    "!=",
    "&",
    "|",
    "^",
    " and ",
    " or ",
    " if ",
    ",",
    "=",
    ":=",
]


class Hang(BaseException):
    """A case took longer than its time."""


class Mutator:
    """Mutations of the tables, the text and the overrides of a scene, all drawn from one
    generator.
    """

    def __init__(self, draw, folder):
        self.draw = draw
        self.folder = folder

    def scene(self, tables):
        """Return the bytes of a mutated scene and its overrides."""
        draw = self.draw
        tables = _copy(tables)
        if draw.random() < 0.5:
            for _ in range(draw.choice((1, 1, 2, 4))):
                self._vary(tables)
            return tomli_w.dumps(tables).encode(), []
        for _ in range(draw.choice((0, 1, 1, 1, 2, 3))):
            self._mutate(tables)
        try:
            text = tomli_w.dumps(tables).encode()
        except (TypeError, ValueError, RecursionError):
            text = b"title = 1"
        if draw.random() < 0.2:
            text = self._bytes(text)
        overrides = [self._override(tables) for _ in range(draw.choice((0, 0, 0, 1, 2)))]
        return text, overrides

    def _mutate(self, tables):
        where, key = self.draw.choice(list(_places(tables)))
        action = self.draw.choice(ACTIONS)
        if action == "drop":
            del where[key]
        elif action == "rename" and isinstance(where, dict):
            where[self.draw.choice((*WORDS, str(key)[:-1], f"{key}s"))] = where.pop(key)
        elif action == "copy":
            where[key] = _copy(self.draw.choice([w[k] for w, k in _places(tables)]))
        elif action == "double" and isinstance(where, list):
            where.append(_copy(where[key]))
        elif action == "nest":
            where[key] = self.draw.choice(([where[key]], {str(key): where[key]}, {"x": where[key]}))
        elif action == "type":
            where[key] = self.draw.choice(
                (
                    True,
                    3,
                    2.5,
                    "text",
                    [],
                    {},
                    [1, 2],
                    ["a"],
                    {"a": 1},
                    [[]],
                    [{}],
                    {"table": "a.csv"},
                )
            )
        elif action == "table":
            where[key] = self._table()
        elif action == "formula":
            where[key] = self._formula(4)
        else:
            where[key] = self._value()

    def _vary(self, tables):
        """Change a number by powers of ten, a switch or a choice; most of these scenes are
        valid.
        """
        draw = self.draw
        where, key = draw.choice(
            [(w, k) for w, k in _places(tables) if not isinstance(w[k], (dict, list))]
        )
        if key in CHOICES:
            where[key] = draw.choice(CHOICES[key])
        elif key in SWITCHES or isinstance(where[key], bool):
            where[key] = draw.choice((True, False, "auto"))
        elif isinstance(where[key], (int, float)):
            scale = 10.0 ** draw.randrange(-30, 31)
            scaled = where[key] * scale if abs(where[key]) < 1e300 else where[key]
            where[key] = draw.choice((scaled, -where[key], 0.0, draw.choice(NUMBERS)))
        else:
            tables.setdefault("model", {})[draw.choice(SWITCHES)] = draw.choice(
                (True, False, "auto")
            )

    def _value(self):
        return self.draw.choice(NUMBERS if self.draw.random() < 0.7 else WORDS)

    def _formula(self, depth):
        draw = self.draw
        kind = draw.random()
        if depth == 0 or kind < 0.3:
            return draw.choice(ATOMS)
        if kind < 0.5:
            arguments = ", ".join(
                self._formula(depth - 1) for _ in range(draw.choice((0, 1, 1, 2, 3)))
            )
            return f"{draw.choice(CALLS)}({arguments})"
        if kind < 0.6:
            return f"{draw.choice(('-', '+', '~', 'not ', 'lambda: '))}{self._formula(depth - 1)}"
        text = f"{self._formula(depth - 1)}{draw.choice(SIGNS)}{self._formula(depth - 1)}"
        return f"({text})" if draw.random() < 0.7 else text

    def _table(self):
        draw = self.draw
        cells = [
            "0",
            "1",
            "-3000",
            "a",
            "",
            "nan",
            "inf",
            "1e400",
            "1e300",
            "1;2",
            "#",
            '"',
            "\x00",
            "1_0",
            "0,5",
        ]
        rows = [
            ",".join(draw.choice(cells) for _ in range(draw.choice((0, 1, 2, 2, 2, 3))))
            for _ in range(draw.randrange(4))
        ]
        path = self.folder / "table.csv"
        path.write_bytes("\n".join(rows).encode() + (b"\xff" if draw.random() < 0.1 else b""))
        name = draw.choice(
            (
                str(path),
                str(path),
                "table.csv",
                "none.csv",
                "/dev/zero",
                str(self.folder),
                "\x00",
                "a" * 5000,
            )
        )
        return {"table": name} | ({"column": draw.choice(cells)} if draw.random() < 0.3 else {})

    def _bytes(self, text):
        draw = self.draw
        at = self.draw.randrange(len(text) + 1)
        junk = bytes(draw.randrange(256) for _ in range(draw.randrange(1, 8)))
        return draw.choice(
            (
                text[:at],
                text[:at] + junk + text[at:],
                text[:at] + junk + text[at + len(junk) :],
                b"\xef\xbb\xbf" + text,
                text.decode().encode("utf-16"),
                text + b"\n" + text,
                text[:at]
                + draw.choice(
                    (b"\n", b"[", b"]", b"=", b'"', b"\x00", b"[a]\n", b"a" * 2000 + b".")
                )
                + text[at:],
                b"x=" + b"[" * 5000,
                b"a." * 3000 + b"a=1",
                junk,
            )
        )

    def _override(self, tables):
        draw = self.draw
        keys = [key for key in _keys(tables)]
        odd = (*WORDS, "a.b.c", "a." * 3000 + "a", "model.x")
        key = draw.choice(keys if keys and draw.random() < 0.8 else odd)
        odd = ("[1", "{a=1}", "'x'", "[[1]]", "0x" + "f" * 5000, "2020-01-01", "\udcff")
        value = draw.choice((self._value(), self._formula(3), *odd))
        return f"{key}={value}" if draw.random() < 0.97 else key


def _copy(value):
    if isinstance(value, dict):
        return {key: _copy(entry) for key, entry in value.items()}
    return [_copy(entry) for entry in value] if isinstance(value, list) else value


def _places(value):
    """Yield (container, key) of every entry of nested tables and lists."""
    for key, entry in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(entry, (dict, list)):
            yield from _places(entry)


def _keys(value, prefix=""):
    """Yield the dotted keys of nested tables and lists."""
    for key, entry in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield f"{prefix}{key}"
        if isinstance(entry, (dict, list)):
            yield from _keys(entry, f"{prefix}{key}.")


def small_scenes():
    """Return the tables of all shipped scenes on a mesh of a few cells, with absolute paths of
    meshes and tables.
    """
    scenes = []
    for _, _, path in list_scenes():
        tables = read_toml(path)
        for axis in "xyz":
            if axis in tables["mesh"]:
                tables["mesh"][axis]["cells"] = [1 if axis == "z" else 2] * (
                    len(tables["mesh"][axis]["points"]) - 1
                )
        _resolve(tables, path.parent)
        scenes.append(tables)
    return scenes


def _resolve(value, folder):
    for where, key in _places(value):
        if key in ("table", "path") and isinstance(where[key], str):
            where[key] = str((folder / where[key]).resolve())


class Fuzz:
    """Cases one after the other, what became of them, and what should not have."""

    def __init__(self, seed, steps, folder):
        self.seed = seed
        self.steps = steps
        self.folder = Path(folder)
        self.scenes = small_scenes()
        self.counts = collections.Counter()
        self.findings = []
        self.path = self.folder / "case.toml"

    def case(self, number):
        """Try one scene and record its outcome."""
        draw = random.Random(f"{self.seed} {number}")
        text, overrides = Mutator(draw, self.folder).scene(draw.choice(self.scenes))
        self.path.write_bytes(text)
        smoke = draw.random() < 0.1
        signal.setitimer(signal.ITIMER_REAL, TIME_LIMIT)
        try:
            outcome = self.outcome(overrides, smoke)
            problem = None
        except InputError as error:
            outcome = "refused"
            problem = _problem(str(error), self.folder)
        except PorofsiError as error:
            outcome = type(error).__name__
            problem = _problem(str(error), self.folder, names=False)
        except (Exception, Hang, SystemExit) as error:
            outcome = "crashed"
            problem = "".join(traceback.format_exception(error))[-1500:]
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        self.counts[outcome] += 1
        if problem:
            self.findings.append((number, problem, overrides, text))

    def outcome(self, overrides, smoke):
        """Return what comes of the case where nothing is raised: valid, checked or run."""
        scene = load_scene(self.path, overrides, smoke)
        if FEW < _cells(scene) < MANY:
            return "valid"
        check(scene)
        if not self.steps:
            return "checked"
        end = min(scene.time.end, self.steps * scene.time.step)
        changes = [f"time.end={end!r}", "expect=[]", "coupling.max_iterations=20"]
        scene = load_scene(self.path, [*overrides, *changes], smoke)
        run(scene, self.folder / "run")
        return "run"


def _cells(scene):
    if scene.mesh.kind == "file":
        return os.path.getsize(scene.mesh.path) / 100 if os.path.isfile(scene.mesh.path) else 0
    product = 1
    for axis in "xyz"[: scene.dim]:
        product *= sum(getattr(scene.mesh, axis).cells)
    return product


def _problem(message, folder, names=True):
    """Return what is wrong with the sentences of an error, None where nothing is."""
    for line in message.replace(str(folder), "DIR").split("\n"):
        if not line.isprintable():
            return f"not printable: {line!r}"
        if len(line) > LONGEST_SENTENCE:
            return f"{len(line)} characters: {line[:300]} ... {line[-200:]}"
        if names and not PLACE.match(line):
            return f"without a place: {line}"
        if "Error" in line or "Exception" in line:
            return f"in words of the program: {line}"
    return None


def check(scene):
    """Do what `porofsi check` does; PETSc's options are left out, they are PETSc's own."""
    importlib.import_module("porofsi_petsc.simulation").check(scene)


def run(scene, directory):
    """Run a scene without figures."""
    module = importlib.import_module("porofsi_petsc.simulation.run")
    with (
        mock.patch.object(module, "make_figures", lambda directory: []),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        module.run(scene, directory, force=True, quiet=True)


def fuzz(cases, seed=0, steps=0, first=0):
    """Try the cases and return the `Fuzz` with its counts and findings."""
    from porofsi_petsc.linalg.options import start

    start()
    previous = signal.signal(signal.SIGALRM, _raise_hang)
    try:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # of NumPy, where numbers are at the ends of their range
            trial = Fuzz(seed, steps, folder)
            for number in range(first, first + cases):
                trial.case(number)
    finally:
        signal.signal(signal.SIGALRM, previous)
    return trial


def keep(trial, folder):
    """Write the input of every finding and what it led to."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for number, problem, overrides, text in trial.findings:
        name = f"case-{trial.seed}-{number}"
        (Path(folder) / f"{name}.toml").write_bytes(text)
        (Path(folder) / f"{name}.txt").write_text(f"{overrides!a}\n{problem}\n")


def _raise_hang(number, frame):
    raise Hang(f"no answer within {TIME_LIMIT:g} s")


def main():
    """Enter from the command line."""
    parser = command_line.parser("fuzz scenes", __doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--keep", default=None)
    choice = parser.parse_args()
    trial = fuzz(choice.cases, choice.seed, choice.steps, choice.first)
    if choice.keep:
        keep(trial, choice.keep)
    print(", ".join(f"{count} {outcome}" for outcome, count in sorted(trial.counts.items())))
    for number, problem, overrides, _ in trial.findings:
        print(
            f"--- case {number} (seed {choice.seed}), overrides {str(overrides)[:300]!a}\n{problem}"
        )
    sys.exit(1 if trial.findings else 0)


if __name__ == "__main__":
    main()
