"""What a constitutive law is to the rest of the package: its parameters in a scene, and its name in
a registry.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any, NamedTuple


class Parameter(NamedTuple):
    """A number of a law that a scene gives: its unit, what it is, its range, its value in tests.

    above : exclusive; default : None where the scene has to give it
    """

    unit: str
    meaning: str
    above: float | None
    at_most: float | None
    default: float | None
    example: float


def parameter(
    unit: str,
    meaning: str,
    *,
    example: float,
    above: float | None = None,
    at_most: float | None = None,
    default: float | None = None,
) -> Any:
    """Return the field of a law's dataclass that a scene gives under the same name; see
    `Parameter`.

    example : an admissible value, with which the tests of all laws run.
    """
    found = Parameter(unit, meaning, above, at_most, default, example)
    given = {} if default is None else {"default": default}
    return dataclasses.field(kw_only=True, metadata={"parameter": found}, **given)


def parameters(law: type) -> dict[str, Parameter]:
    """Return the parameters that a law has beside those of all laws, by the key of the scene."""
    fields = dataclasses.fields(law)
    return {
        field.name: field.metadata["parameter"] for field in fields if "parameter" in field.metadata
    }


def examples(law: type) -> dict[str, float]:
    """Return an admissible value for each parameter of a law."""
    return {name: entry.example for name, entry in parameters(law).items()}


class Registry(Mapping):
    """Name in a scene -> law.  Packages add theirs by entry points of the group, scripts by
    `register`.

    changed : called after a law has come
    """

    def __init__(self, kind: str, group: str, laws: Mapping[str, type]):
        """Take what its laws are called in messages, the group of entry points, and the laws of
        this package.
        """
        self._kind = kind
        self._group = group
        self._laws = dict(laws)
        self._complete = False
        self.changed: list[Callable[[], None]] = []

    def register(self, name: str) -> Callable[[type], type]:
        """Return the decorator that adds a law under a name; ValueError where the name is taken by
        another.
        """

        def add(law: type) -> type:
            self._add(name, law)
            for tell in self.changed:
                tell()
            return law

        return add

    def _add(self, name, law):
        known = self._laws.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (
            law.__module__,
            law.__qualname__,
        ):
            raise ValueError(
                f"{self._kind} '{name}': the name has {known.__qualname__} of {known.__module__},"
                " take another"
            )
        self._laws[name] = law

    @property
    def _all(self):
        if not self._complete:
            self._complete = True
            for entry in entry_points(group=self._group):
                self._add(entry.name, entry.load())
        return self._laws

    def __getitem__(self, name: str) -> type:
        return self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)
