"""Whether a mesh fits into the memory of this machine, before any of it is made."""

import os
import resource
from pathlib import Path

from ..errors import InputError

# Peak while a mesh is generated, per grid cell (2 triangles, 6 tetrahedra), by tracemalloc: 567
# bytes in 2-D and 2790 in 3-D of either order.  A run needs more; what is refused for this has no
# chance.
BYTES_PER_GRID_CELL = {2: 560, 3: 2700}
GROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")  # of a container or a batch job


def require_memory(grid_cells: int, dim: int, where: str) -> None:
    """Raise InputError when the mesh of so many grid cells is larger than the memory of this
    machine.
    """
    needed = grid_cells * BYTES_PER_GRID_CELL[dim]
    present = memory()
    if needed > present:
        text = (
            f"received {grid_cells:.3g} grid cells, whose mesh alone takes {needed / 2**30:.3g} GiB"
        )
        raise InputError(
            f"{where}: {text} of the {present / 2**30:.3g} GiB of this machine; take fewer cells"
        )


def memory() -> int:
    """Return the bytes that this process may have: the machine's, or less where a limit is set."""
    limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if allowed != resource.RLIM_INFINITY:
        limits.append(allowed)
    try:
        limits.append(int(GROUP_LIMIT.read_text()))
    except (OSError, ValueError):  # no such limit, or "max"
        pass
    return min(limits)
