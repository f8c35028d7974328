"""An XDMF file of times that costs the same for every time: a temporal collection of grids.

XML ends with closing tags, behind which nothing may be added. So there are two files that take
turns: to the one without the name are added the times that it lacks, its own closing tags are
overwritten by them and new ones, and then it takes the name from the other one, by a rename. What
has the name is complete at any moment, after a kill too, and two grids are written for a time.
"""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from .files import keep_content, keep_names, temporary_name
from .hdf5 import Layout

ATTRIBUTE_TYPE = {(): "Scalar", (3,): "Vector", (6,): "Tensor6"}
HEAD = b"""<?xml version="1.0" ?>
<Xdmf Version="3.0"><Domain>
<Grid Name="fields" GridType="Collection" CollectionType="Temporal">
"""
TAIL = b"""</Grid>
</Domain></Xdmf>
"""


class Collection:
    """The file of a temporal collection; on the calling rank only."""

    def __init__(self, path: Path) -> None:
        """Take the path; `rewrite` makes the file."""
        self._path = path
        self._spare = temporary_name(path)
        self._third = path.with_name(path.name + ".next")
        self._grids: list[bytes] = []
        self._in_spare = 0  # grids that the file without the name has

    def rewrite(self, grids: Sequence[str]) -> None:
        """Write all grids, in the order of time."""
        self._grids = [grid.encode() for grid in grids]
        self._rewrite()

    def append(self, grid: str) -> None:
        """Add a grid of a later time."""
        self._grids.append(grid.encode())
        if not (self._path.exists() and self._spare.exists()):  # somebody has tidied up
            self._rewrite()
            return
        with open(self._spare, "r+b") as file:
            file.seek(-len(TAIL), os.SEEK_END)
            file.write(b"".join(self._grids[self._in_spare :]) + TAIL)
        self._in_spare = len(self._grids) - 1
        self._exchange()

    def close(self) -> None:
        """Leave the file alone and force it to the disk."""
        self._spare.unlink(missing_ok=True)
        self._third.unlink(missing_ok=True)
        keep_content(self._path)
        keep_names(self._path.parent)

    def _rewrite(self):
        text = HEAD + b"".join(self._grids) + TAIL
        self._spare.write_bytes(text)
        os.replace(self._spare, self._path)
        self._spare.write_bytes(text)
        self._in_spare = len(self._grids)

    def _exchange(self):
        """Exchange the names of the two files; at any moment one has that of the collection."""
        self._third.unlink(missing_ok=True)
        try:
            os.link(self._path, self._third)
        except OSError:  # a file system without hard links
            shutil.copyfile(self._path, self._third)
        os.replace(self._spare, self._path)
        os.replace(self._third, self._spare)


class Grids(NamedTuple):
    """The grids of a mesh at different times, as XDMF.

    topology : XDMF's name of the cells; n_points : N; cells_shape : (E, A); folder : of mesh.h5
    beside the XDMF file
    """

    topology: str
    n_points: int
    cells_shape: tuple[int, int]
    folder: str

    def at(self, step: int, time: float, place: str, fields: dict[str, Layout]) -> str:
        """Return the grid of a time [s]; place : the file of its fields."""
        mesh = f"{self.folder}/mesh.h5"
        cells = _item(f"{mesh}:/cells", self.cells_shape, "Int", 8)
        points = _item(f"{mesh}:/points", (self.n_points, 3), "Float", 8)
        region = _item(f"{mesh}:/region", self.cells_shape[:1], "Int", 4)
        lines = [
            f'<Grid Name="step {step}" GridType="Uniform"><Time Value="{time:.17g}"/>',
            f'<Topology TopologyType="{self.topology}" NumberOfElements="{self.cells_shape[0]}">'
            f"{cells}</Topology>",
            f'<Geometry GeometryType="XYZ">{points}</Geometry>',
            f'<Attribute Name="region" AttributeType="Scalar" Center="Cell">{region}</Attribute>',
        ]
        for name, (shape, precision) in sorted(fields.items()):
            kind = ATTRIBUTE_TYPE[tuple(shape[1:])]
            lines.append(
                f'<Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="Node">'
                f"{_item(f'{place}:/{name}', shape, 'Float', precision)}</Attribute>"
            )
        return "\n".join(lines) + "\n</Grid>\n"


def _item(location, shape, kind, precision):
    dimensions = " ".join(map(str, shape))
    return (
        f'<DataItem DataType="{kind}" Precision="{precision}" Dimensions="{dimensions}"'
        f' Format="HDF">{location}</DataItem>'
    )
