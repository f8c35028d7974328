"""From a mesh file of any known format to what it says: some by readers of their own, others by
meshio.
"""

import contextlib
import io
import re
from pathlib import Path

import numpy as np

from ..errors import InputError, shown
from .abaqus import read_abaqus
from .arrays import NOT_A_TAG, integer_arrays, scalar_arrays
from .exodus import read_exodus
from .febio import read_febio
from .gmsh import read_gmsh
from .kratos import read_kratos
from .source import Block, Source, Unusable
from .su2 import read_su2
from .xdmf import read_xdmf

# Formats of surfaces, or in several files; meshio's readers of most of them do not end on broken
# ones.
WITHOUT_GROUPS = (".dat", ".ele", ".node", ".obj", ".off", ".ply", ".stl", ".tec", ".wkt")
# Formats whose groups meshio does not read.
NOT_READ = {".unv": "a universal file, whose groups are not read"}
NASTRAN = (".bdf", ".fem", ".nas")
# Cells that meshio knows, but for their dimension
BODIES = ("penta_prism", "hexa_prism", "wedge15", "wedge18", "pyramid13", "pyramid14")
POLYHEDRA = "it has polyhedra, of which no element is made; mesh the body with tetra or hexahedron"


def read_source(path: Path) -> Source:
    """Return the content of a file; raises InputError (one sentence) where it is not readable."""
    suffix = path.suffix.lower()
    if suffix in WITHOUT_GROUPS:
        advice = "give a mesh of cells in named groups, such as Gmsh .msh 2.2 or 4.1"
        raise InputError(f"{path}: a {path.suffix} file has no named boundaries; {advice}")
    if suffix in NOT_READ:
        advice = "save the mesh as Gmsh .msh 2.2 or 4.1, Abaqus .inp or MED"
        raise InputError(f"{path}: {NOT_READ[suffix]}; {advice}")
    if suffix in NASTRAN and b"ENDDATA" not in path.read_bytes().rpartition(b"BEGIN BULK")[2]:
        # meshio would look for it for ever
        raise InputError(
            f"{path}: no ENDDATA follows on the BEGIN BULK of the Nastran file; write the mesh"
            " again"
        )
    try:
        return READERS.get(suffix, _read_by_meshio)(path)
    except Unusable as error:
        raise InputError(f"{path}: {error}") from error
    except (Exception, SystemExit) as error:
        if suffix == ".vtk" and _has_polyhedra(path):
            raise InputError(f"{path}: {POLYHEDRA}") from error
        reason = "" if isinstance(error, SystemExit) else f" ({_reason(error)})"
        raise InputError(
            f"{path}: not readable as a mesh{reason}; give a file that meshio reads, such as Gmsh"
            " .msh 2.2 or 4.1"
        ) from error


def _read_msh(path):
    """Return the content of a .msh file: of Gmsh, or as CalculiX writes it, which is Abaqus's."""
    with path.open("rb") as file:
        start = file.read(1000).lstrip()
    return read_abaqus(path) if start.startswith(b"*") else read_gmsh(path)


def _has_polyhedra(path):
    """Return whether a legacy VTK file in text has cells of type 42."""
    types = re.search(rb"CELL_TYPES\s+\d+\s+([\d\s]+)", path.read_bytes())
    return types is not None and b"42" in types[1].split()


def _reason(error):
    if isinstance(error, ModuleNotFoundError):
        return f"Python's package {error.name} is needed for the format and is not installed"
    return f"{type(error).__name__}: {shown(str(error))}"


def known_to_meshio() -> None:
    """Tell meshio the dimension of the cells of which it does not know it, and so cannot hold."""
    from meshio import _mesh

    for kind in BODIES:
        _mesh.topological_dimension.setdefault(kind, 3)


def _read_by_meshio(path):
    """Return what meshio reads; it prints and exits on a file it cannot read, and its readers raise
    nearly anything.
    """
    import meshio  # slow to import, and most scenes make their mesh themselves

    known_to_meshio()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        source = meshio.read(path)
    if any(block.type.startswith("polyhedron") for block in source.cells):
        raise Unusable(POLYHEDRA)
    blocks = [Block(block.type, block.dim, block.data) for block in source.cells]
    arrays = integer_arrays(source.cell_data)
    sets = {
        name: [_members(part) for part in parts]
        for name, parts in source.cell_sets.items()
        if name not in NOT_A_TAG
    }
    if getattr(source, "cell_tags", None):
        sets |= _families(arrays.pop("cell_tags", []), source.cell_tags)
    nodes = {name: _members(part) for name, part in source.point_sets.items()}
    if getattr(source, "point_tags", None):
        of_nodes = _families([source.point_data["point_tags"]], source.point_tags)
        nodes |= {name: parts[0] for name, parts in of_nodes.items()}
    values = scalar_arrays(source.cell_data)
    return Source(source.points, blocks, sets, arrays, nodes, values=values)


def _members(part):
    return np.asarray([] if part is None else part, dtype=np.int64)


def _families(families, names):
    """Return the sets of a MED file: a family of cells is in all groups whose names it has."""
    groups = sorted({name for of_family in names.values() for name in of_family})
    holders = {g: [family for family, own in names.items() if g in own] for g in groups}
    return {
        group: [np.flatnonzero(np.isin(part, holding)) for part in families]
        for group, holding in holders.items()
    }


READERS = {".msh": _read_msh, ".inp": read_abaqus, ".mdpa": read_kratos, ".feb": read_febio}
READERS[".su2"] = read_su2
READERS |= dict.fromkeys((".xdmf", ".xmf"), read_xdmf)
READERS |= dict.fromkeys((".e", ".ex2", ".exo", ".g", ".gen"), read_exodus)
