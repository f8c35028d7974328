"""What the configuration of preCICE says and its interface does not tell a participant."""

import xml.sax
from dataclasses import dataclass, field
from os import PathLike
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl

TRUE = ("1", "yes", "true", "on")
CONSERVATIVE = "conservative"
SCHEME = "coupling-scheme:"


@dataclass(frozen=True)
class Iterations:
    """Those of the implicit coupling scheme of a participant.

    most : max-iterations, None where there is no such bound or no iteration; strict : whether each
    convergence measure is, so that preCICE itself ends the run where one is not met
    """

    most: int | None = None
    strict: bool = False

    def has_last(self, iterations: int) -> bool:
        """Return whether an iteration is the last one that is allowed."""
        return self.most is not None and iterations >= self.most

    def end_agrees(self, iterations: int) -> bool:
        """Return whether the data agree at the end of a window that took some iterations."""
        return self.strict or not self.has_last(iterations)


@dataclass(frozen=True)
class Mapping:
    """A mapping between two meshes, by their names; constraint : what it keeps, as preCICE calls
    it.
    """

    source: str
    target: str
    constraint: str

    @property
    def keeps_sums(self) -> bool:
        """Return whether it is one of forces, whose sum stays."""
        return self.constraint == CONSERVATIVE


class Configuration(ContentHandler):
    """A file of configuration that preCICE has read; mappings : all between named meshes.

    The names of its elements have prefixes without a namespace, which SAX alone reads.
    """

    def __init__(self, path: str | PathLike) -> None:
        """Read the file."""
        super().__init__()
        self.mappings: list[Mapping] = []
        self._schemes: list[_Scheme] = []
        self._in_scheme = False
        xml.sax.parse(str(path), self)

    def iterations(self, participant: str) -> Iterations:
        """Return the `Iterations` of a participant."""
        for scheme in self._schemes:
            if participant in scheme.members and scheme.most is not None:
                return Iterations(scheme.most, bool(scheme.strict) and all(scheme.strict))
        return Iterations()

    def startElement(self, name: str, attrs: AttributesImpl) -> None:
        """Note an element."""
        if name.startswith("mapping:"):
            places = (attrs.get(key, "") for key in ("from", "to", "constraint"))
            self.mappings.append(Mapping(*places))
        elif name.startswith(SCHEME):
            self._schemes.append(_Scheme())
            self._in_scheme = True
        elif self._in_scheme:
            self._schemes[-1].note(name, attrs)

    def endElement(self, name: str) -> None:
        """Note where a coupling scheme ends."""
        if name.startswith(SCHEME):
            self._in_scheme = False


@dataclass
class _Scheme:
    """What a coupling scheme says: its participants, max-iterations, and whether each convergence
    measure is strict.
    """

    members: set[str] = field(default_factory=set)
    most: int | None = None
    strict: list[bool] = field(default_factory=list)

    def note(self, name: str, attrs: AttributesImpl) -> None:
        """Take an element within."""
        if name == "participants":
            self.members |= {attrs["first"], attrs["second"]}
        elif name == "participant":
            self.members.add(attrs["name"])
        elif name == "max-iterations":
            self.most = int(attrs["value"])
        elif name.endswith("-convergence-measure"):
            self.strict.append(attrs.get("strict", "false").lower() in TRUE)
