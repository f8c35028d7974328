"""The section of a scene whose interface is shared with another program."""

from .geometry import FileName
from .types import Table, Tags, Text


class Precice(Table):
    """One participant of a run coupled by preCICE.

    config : its configuration, a relative path starts at the scene's folder; participant, mesh :
    names there; on : tags of the interface; read, write : names of data: a solid reads forces [N]
    and writes displacements [m], a fluid the other way round
    """

    config: FileName
    participant: Text
    mesh: Text
    on: Tags
    read: Text
    write: Text
