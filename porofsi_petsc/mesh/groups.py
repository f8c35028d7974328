"""Which cells and facets of a mesh file belong to which name."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, listed
from .arrays import KNOWN, are_distinct
from .gmsh import ELEMENTARY
from .source import NO_GROUP, Source, numbered


def named_sets(
    source: Source, groups: Sequence[str], path: Path
) -> tuple[dict[str, list[np.ndarray]], dict[str, np.ndarray]]:
    """Return name -> numbers of the cells of each block, and name -> nodes.

    groups : the names that count, all if empty.  Raises InputError for a group that the file does
    not have.
    """
    sets = source.sets
    nodes = source.node_sets
    if groups:
        known = {**nodes, **sets}
        for name in groups:
            if name not in known:
                raise InputError(
                    f"{path}: mesh.groups names '{name}', which the file does not have; choose from"
                    f" {listed(sorted(known))}"
                )
        sets = {name: sets[name] for name in groups if name in sets}
        nodes = {name: nodes[name] for name in groups if name in nodes}
    return sets, nodes


def require_array(sources: Sequence[Source], array: str | None, path: Path) -> None:
    """Raise InputError unless one of the sources has the array, if one is given."""
    arrays = [name for source in sources for name in _candidates(source)]
    if array is not None and array not in arrays:
        raise InputError(
            f"{path}: mesh.array = '{array}', but the file has no such array of integers over"
            f" its cells; choose from {listed(arrays) or 'none'}, or leave the key out"
        )


def sets_of(
    source: Source, array: str | None, path: Path, distinct: bool = False
) -> dict[str, list[np.ndarray]]:
    """Return name -> numbers of the cells of each block: those of the array, if the source has it,
    else its sets or, if it has none, those of the one array that can be meant.

    distinct : an array may have another number for every cell.  Raises InputError for several
    arrays.
    """
    found = _candidates(source, distinct)
    if array in found:
        return _numbers(source, array)
    if source.sets:
        return source.sets
    found = [name for name in found if name != ELEMENTARY]
    known = [name for name in KNOWN if name in found]
    if len(found) > 1 and not known:
        raise InputError(
            f"{path}: several integer arrays over the cells ({listed(found)}); name the one with"
            f' the groups, mesh.array = "{found[0]}"'
        )
    return _numbers(source, [*known, *found][0]) if found else {}


def _candidates(source, distinct=False):
    return [name for name, parts in source.arrays.items() if distinct or not are_distinct(parts)]


def _numbers(source, array):
    parts = source.arrays[array]
    numbers = np.unique(np.concatenate(parts)).tolist() if parts else []
    return {
        numbered(n): [np.flatnonzero(part == n) for part in parts] for n in numbers if n != NO_GROUP
    }


def one_each(
    sets: Mapping[str, np.ndarray], count: int, chosen: bool, alike: bool
) -> tuple[dict[str, np.ndarray], list[str], tuple[str, str, int] | None]:
    """Return sets without those that finer ones make up, the names left out, and two that overlap
    with a member of both, None where no two do.

    sets : name -> members, numbers below count.  A set goes if it has all the members there are,
    or those of smaller sets together, or those of a set with a name where it has only a number.
    chosen : the first of two sets keeps a common member.  alike : of sets with the same members one
    is enough.
    """
    times = np.zeros(count, dtype=np.int64)
    for members in sets.values():
        times[members] += 1
    kept = dict(sets)
    if times.max(initial=0) <= 1:
        return kept, [], None
    if chosen:
        taken = np.zeros(count, dtype=bool)
        for name, members in sets.items():
            kept[name] = members[~taken[members]]
            taken[members] = True
        return {name: members for name, members in kept.items() if len(members)}, [], None
    left_out = []
    for name in sorted(sets, key=lambda name: (-len(sets[name]), not _is_plain(name))):
        if _is_made_up(name, kept, count) or _is_double(name, kept, alike):
            del kept[name]
            left_out.append(name)
    return kept, left_out, _overlap(kept, count)


def _is_plain(name):
    """Return whether a name is one that nobody chose: a number, or of Abaqus's own making."""
    return name.startswith(("group_", "_"))


def _is_double(name, sets, alike):
    """Return whether there is a set with the same members to keep for this one."""
    return any(
        other != name and (alike or _is_plain(name)) and np.array_equal(sets[name], members)
        for other, members in sets.items()
    )


def _is_made_up(name, sets, count):
    own = np.zeros(count, dtype=bool)
    own[sets[name]] = True
    finer = np.zeros(count, dtype=bool)
    for other, members in sets.items():
        if other != name and len(members) < own.sum() and own[members].all():
            finer[members] = True
    smaller = any(0 < len(m) < count for other, m in sets.items() if other != name)
    return bool(own.any() and ((finer == own).all() or (own.all() and smaller)))


def _overlap(sets, count):
    """Return the names of two sets that have a member in common, and that member."""
    holder = np.full(count, -1)
    names = list(sets)
    for index, members in enumerate(sets.values()):
        both = members[holder[members] >= 0]
        if len(both):
            return names[holder[both[0]]], names[index], int(both[0])
        holder[members] = index
    return None
