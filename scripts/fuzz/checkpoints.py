"""Restart from damaged checkpoints: each is refused in one sentence, or the run goes on as if
nothing had happened.

The kinds of damage (`DAMAGES`) take turns.  Those of bytes and those made with HDF5 keep the old
checksum, as a disk or another program would; those called "sealed" get a new one, so that only what
the file says can be wrong.  What comes out otherwise is printed with its seed, and the exit code is
1.
"""

import collections
import faulthandler
import importlib
import json
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import command_line
import h5py
import numpy as np
from mpi4py import MPI

from porofsi_petsc import load_scene, run
from porofsi_petsc.errors import InputError
from porofsi_petsc.output.checkpoint import NAME, PREVIOUS
from porofsi_petsc.output.seal import seal

HANGS = 120  # [s] after which a restart counts as one that hangs; the stack is printed
SCENE = """
title = "a block on which a load grows"
[mesh]
kind = "rectangle"
x = { points = [0.0, 1.0], cells = [2] }
y = { points = [0.0, 1.0], cells = [3] }
[time]
end = 6e-3
step = 1e-3
growth = 1.1
[[material]]
region = "body"
porosity = 0.33
solid = { law = "neo_hookean", lambda = 8.375e6, mu = 5.583e6, density = 2000.0 }
fluid = { density = 1000.0, specific_weight = 1e4 }
permeability = { law = "constant", k = 1e-2 }
[model]
moving_mesh = true
[coupling]
accelerator = "iqn_ils"
[[boundary]]
on = ["left", "right"]
displacement = { x = 0.0 }
velocity = { x = 0.0 }
[[boundary]]
on = "bottom"
displacement = { y = 0.0 }
velocity = { y = 0.0 }
[[boundary]]
on = "top"
pressure = 0.0
traction = { y = "-1e6*t" }
[[probe]]
name = "top"
at = [0.5, 1.0]
quantities = ["u_y", "vf_y"]
[output]
checkpoint_every = 3
fields_every = 3
"""
WRONG = (
    "text",
    "",
    [],
    {},
    True,
    float("nan"),
    float("-inf"),
    10**400,
    [[1]],
    {"a": None},
)  # no entry is one of these
OPTIONAL = {
    "columns",
    "tables",
    "regions",
    "step_control",
}  # entries that a checkpoint of an earlier version does not have
NO_TOML = ("title = ", "[time", "\0", "a = 1\na = 2", "[[material]]\nregion = 3")


# -- damage to bytes -------------------------------------------------------------------------------


def change_bytes(change):
    """Return the damage that replaces the content of a file by change(content, rng)."""

    def damage(path, rng):
        path.write_bytes(change(bytearray(path.read_bytes()), rng))

    return damage


def flip(content, rng):
    """Flip one bit."""
    content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return content


def flip_many(content, rng):
    """Flip up to 64 bits."""
    for _ in range(rng.integers(2, 65)):
        flip(content, rng)
    return content


def truncate(content, rng):
    """Keep the first bytes, perhaps none."""
    return content[: rng.integers(len(content))]


def fill(content, rng):
    """Fill a block with zeros or random bytes."""
    start = rng.integers(len(content))
    size = int(rng.integers(1, 4097))
    block = bytes(size) if rng.integers(2) else rng.bytes(size)
    content[start : start + size] = block[: len(content) - start]
    return content


def swap(content, rng):
    """Swap two blocks."""
    size = int(rng.integers(1, 1025))
    a, b = (int(start) for start in rng.integers(len(content) - size, size=2))
    first = content[a : a + size]
    second = content[b : b + size]
    content[b : b + size] = first
    content[a : a + size] = second
    return content


def shift(content, rng):
    """Remove some bytes or repeat them, the checksum among them or not."""
    start = int(rng.integers(len(content)))
    size = int(rng.integers(1, 1025))
    return content[:start] + (
        content[start + size :] if rng.integers(2) else content[max(0, start - size) :]
    )


def unseal(content, rng):
    """Remove what is in front of the HDF5 file, as if an earlier version had written it."""
    return content[512:]


def append(content, rng):
    """Add bytes at the end."""
    return content + rng.bytes(int(rng.integers(1, 2000)))


# -- damage by HDF5 --------------------------------------------------------------------------------


def change_arrays(change, sealed):
    """Return the damage that changes an open HDF5 file by change(file, names, rng)."""

    def damage(path, rng):
        with h5py.File(path, "r+") as file:
            change(file, sorted(file), rng)
        if sealed:
            seal(path, MPI.COMM_SELF)

    return damage


def swap_arrays(file, names, rng):
    """Give two arrays the name of the other."""
    a, b = rng.choice(names, 2, replace=False)
    file.move(a, "swapped")
    file.move(b, a)
    file.move("swapped", b)


def change_number(file, names, rng):
    """Change one number by a relative 1e-3."""
    array = file[rng.choice(names)]
    values = array[()]
    values.ravel()[rng.integers(values.size)] += 1e-3 * np.abs(values).max(initial=1e-3)
    array[...] = values


def replace_array(file, names, rng):
    """Replace an array by one of another shape or type, or by something that is none; or remove
    it.
    """
    name = rng.choice([name for name in names if not name.startswith("accelerator.")])
    values = file[name][()]
    other = [
        values[:-1],
        np.concatenate([values, values[:1]]),
        np.stack([values, values], axis=-1),
        values.astype("f4"),
        values.astype("i8"),
        values.astype(">f8"),
        np.full_like(values, np.nan),
        np.full(len(values), b"text"),
        3.0,
        "text",
        h5py.Empty("f8"),
        None,
        {},
    ]
    del file[name]
    chosen = other[rng.integers(len(other))]
    if isinstance(chosen, dict):
        file.create_group(name)
    elif chosen is not None:
        file[name] = chosen


# -- damage to the header --------------------------------------------------------------------------


def change_header(change, sealed=True):
    """Return the damage that changes the header, a dict, by change(header, rng); it may return
    other text for it.
    """

    def damage(file, names, rng):
        header = json.loads(file.attrs["header"])
        text = change(header, rng)
        file.attrs["header"] = json.dumps(header) if text is None else text

    return change_arrays(damage, sealed)


def entries(table, place=()):
    """Yield the place of every entry below a table: the keys that lead to it."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*place, key)
        if isinstance(value, (dict, list)):
            yield from entries(value, (*place, key))


def some_entry(header, rng):
    """Return the table and the key of an entry."""
    places = list(entries(header))
    *above, key = places[rng.integers(len(places))]
    for name in above:
        header = header[name]
    return header, key


def spoil_entry(header, rng):
    """Give an entry a value that it cannot have."""
    table, key = some_entry(header, rng)
    wrong = [
        value
        for value in WRONG
        if type(value) is not type(table[key]) or not isinstance(value, (str, list, dict))
    ]
    table[key] = wrong[rng.integers(len(wrong))]


def remove_entry(header, rng):
    """Remove an entry that no version may lack."""
    table, key = some_entry(header, rng)
    while key in OPTIONAL or isinstance(table, list):
        table, key = some_entry(header, rng)
    del table[key]


def contradict(header, rng):
    """Let two entries say different things, or one what cannot be."""
    edits = [
        lambda: header.update(time=header["time"] * 1.8),
        lambda: header["clock"].update(t=header["clock"]["t"] * 1.8),
        lambda: header.update(step=header["step"] + 1),
        lambda: header["clock"].update(step=header["clock"]["step"] + 1),
        lambda: header.update(step=5.5),
        lambda: header["clock"].update(nominal=-1e-3),
        lambda: header["clock"].update(cuts=-1),
        lambda: header["iterations"].append(3),
        lambda: header.update(iterations="3, 3, 3"),
        lambda: header.update(mesh_hash="0" * 16),
        lambda: header.update(nodes=header["nodes"] + 1),
        lambda: header.update(format_version=1),
        lambda: header.update(format_version=99),
        lambda: header["coupling"]["columns"].append(2),
    ]
    edits[rng.integers(len(edits))]()


def spoil_scene(header, rng):
    """Break the text of the scene, or let it be another one."""
    wrong = [
        *NO_TOML,
        header["scene"][: len(header["scene"]) // 2],
        header["scene"].replace("5583000", "5583001"),
    ]
    header["scene"] = wrong[rng.integers(len(wrong))]


def no_header(header, rng):
    """Replace the header by text that is none."""
    wrong = ("", "{", "[]", "3", "null", '"text"', "[" * 5000, json.dumps(header)[:-20], "{}")
    return wrong[rng.integers(len(wrong))]


# -- other files -----------------------------------------------------------------------------------


def foreign(path, rng):
    """Put another file of the run, another HDF5 file, text, a folder or nothing in the place of the
    checkpoint.
    """
    others = [
        path.parent / name
        for name in ("history.csv", "fields/mesh.h5", "fields/000003.h5", "scene.toml")
    ]
    chosen = rng.integers(len(others) + 4)
    path.unlink()
    if chosen < len(others):
        shutil.copy(others[chosen], path)
    elif chosen == len(others):
        path.mkdir()
    elif chosen == len(others) + 1:
        path.write_text("text\n" * 1000)
    elif chosen == len(others) + 2:
        with h5py.File(path, "w", userblock_size=512) as file:
            file["solid.u"] = np.zeros((12, 2))


DAMAGES = {
    "none": lambda path, rng: None,
    "one bit": change_bytes(flip),
    "some bits": change_bytes(flip_many),
    "truncated": change_bytes(truncate),
    "block of zeros or noise": change_bytes(fill),
    "blocks swapped": change_bytes(swap),
    "bytes lost or repeated": change_bytes(shift),
    "no checksum": change_bytes(unseal),
    "bytes appended": change_bytes(append),
    "arrays swapped": change_arrays(swap_arrays, False),
    "a number changed": change_arrays(change_number, False),
    "an entry changed": change_header(spoil_entry, False),
    "sealed, an array replaced": change_arrays(replace_array, True),
    "sealed, an entry wrong": change_header(spoil_entry),
    "sealed, an entry missing": change_header(remove_entry),
    "sealed, a contradiction": change_header(contradict),
    "sealed, another scene": change_header(spoil_scene),
    "sealed, no header": change_header(no_header),
    "another file": foreign,
}


# -- runs ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Runs:
    """A whole run, and the same with the checkpoint of its middle, to which the damage is done."""

    folder: Path
    scene: object

    @classmethod
    def made_in(cls, folder: Path):
        """Do the run, and make sure that it goes on from its middle as if nothing had happened."""
        path = folder / "scene.toml"
        path.write_text(SCENE)
        runs = cls(folder, load_scene(path))
        do(runs.scene, folder / "whole")
        shutil.copytree(folder / "whole", folder / "half")
        (folder / "half" / PREVIOUS).replace(folder / "half" / NAME)
        if (outcome := runs.outcome("none", 0)) != "identical":
            raise RuntimeError(f"a restart without damage gives {outcome}")
        return runs

    def outcome(self, kind: str, seed: int) -> str:
        """Return "refused", "identical" or what else a restart from a damaged checkpoint does."""
        directory = self.folder / "damaged"
        shutil.rmtree(directory, ignore_errors=True)
        shutil.copytree(self.folder / "half", directory)
        DAMAGES[kind](directory / NAME, np.random.default_rng(seed))
        try:
            do(self.scene, directory, directory / NAME)
        except InputError as refusal:
            text = str(refusal)
            sentence = "\n" not in text and text.startswith(str(directory / NAME))
            return "refused" if sentence else f"refused by {text!r}"
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        return (
            "identical"
            if content(directory) == content(self.folder / "whole")
            else "another result"
        )


def do(scene, directory, restart=None):
    """Run a scene without figures."""
    with mock.patch.object(
        importlib.import_module("porofsi_petsc.simulation.run"),
        "make_figures",
        lambda directory: [],
    ):
        run(scene, directory, restart=restart, quiet=True)


def content(directory):
    """Return what a run has computed: its history, and state and header of its last checkpoint."""
    with h5py.File(directory / NAME, "r") as file:
        arrays = {name: array[()].tobytes() for name, array in file.items()}
        return (directory / "history.csv").read_text(), arrays, json.loads(file.attrs["header"])


def fuzz(number: int, seed: int, folder: Path) -> list:
    """Return (kind, seed, outcome) of a number of damaged checkpoints."""
    runs = Runs.made_in(folder)
    kinds = [kind for kind in DAMAGES if kind != "none"]
    found = []
    for i in range(number):
        faulthandler.dump_traceback_later(HANGS, exit=True)
        kind = kinds[i % len(kinds)]
        found.append((kind, seed + i, runs.outcome(kind, seed + i)))
    faulthandler.cancel_dump_traceback_later()
    return found


def wrong(found: list) -> list:
    """Return those of `fuzz` that came out otherwise."""
    return [entry for entry in found if entry[2] not in ("refused", "identical")]


def main():
    """Print the outcomes by kind of damage."""
    parser = command_line.parser("fuzz checkpoints", __doc__)
    parser.add_argument("--number", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    choice = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(choice.number, choice.seed, Path(folder))
    counts = collections.Counter(
        (kind, outcome) for kind, _, outcome in found if outcome in ("refused", "identical")
    )
    for (kind, outcome), count in sorted(counts.items()):
        print(f"{kind:28} {outcome:10} {count}")
    for kind, seed, outcome in wrong(found):
        print(f"WRONG: {kind}, seed {seed}: {outcome}")
    print(f"{len(found)} damaged checkpoints, {len(wrong(found))} wrong")
    sys.exit(bool(wrong(found)))


if __name__ == "__main__":
    main()
