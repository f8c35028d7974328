"""What laws and boundary conditions are to the rest of the package: their parameters in a scene,
and their names in a registry.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any, Literal, NamedTuple


class Parameter(NamedTuple):
    """What a scene gives to a law or a condition: its unit, what it is, its range, its value in
    tests.

    kind : "number", "numbers" (up to three in a list, each in the range; for laws alone), "word"
    (one of `words`; for laws alone), "formula" of time and position, or "vector" of formulas; above
    : exclusive;
    default : None where the scene has to give it, {} of a vector that may be left out
    """

    kind: Literal["number", "numbers", "word", "formula", "vector"]
    unit: str
    meaning: str
    above: float | None
    at_least: float | None
    at_most: float | None
    default: Any
    example: Any
    words: tuple[str, ...] = ()


def parameter(
    unit: str,
    meaning: str,
    *,
    example: Any,
    kind: Literal["number", "numbers", "word", "formula", "vector"] = "number",
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    default: Any = None,
    words: tuple[str, ...] = (),
) -> Any:
    """Return the field of a dataclass that a scene gives under the same name; see `Parameter`.

    example : an admissible value, with which the tests of all that is registered run.
    """
    found = Parameter(kind, unit, meaning, above, at_least, at_most, default, example, words)
    given: dict[str, Any] = {} if default is None else _default(default)
    return dataclasses.field(kw_only=True, metadata={"parameter": found}, **given)


def _default(value):
    """Return the argument of `dataclasses.field`."""
    return {"default_factory": dict} if value == {} else {"default": value}


def parameters(law: type) -> dict[str, Parameter]:
    """Return the parameters that a law or condition has beside those of all, by the key of the
    scene.
    """
    fields = dataclasses.fields(law) if dataclasses.is_dataclass(law) else ()
    return {
        field.name: field.metadata["parameter"] for field in fields if "parameter" in field.metadata
    }


def examples(law: type) -> dict[str, Any]:
    """Return an admissible value for each parameter of a law or condition."""
    return {name: entry.example for name, entry in parameters(law).items()}


def _in_range(value, entry):
    if entry.kind == "numbers":
        return all(_in_range(number, entry._replace(kind="number")) for number in value)
    return (
        (entry.above is None or value > entry.above)
        and (entry.at_least is None or value >= entry.at_least)
        and (entry.at_most is None or value <= entry.at_most)
    ) and value == value


# Names that the table of a law has in a scene, whatever the law.
OF_TABLES = frozenset("law of_law common copy dict json schema construct validate".split())


class Registry(Mapping[str, Any]):
    """Name in a scene -> law or condition.  Packages add theirs by entry points of the group,
    scripts by `register`.

    changed : called after one has come
    """

    def __init__(
        self,
        kind: str,
        group: str,
        laws: Mapping[str, type],
        taken: Iterable[str] = (),
        reserved: Iterable[str] = (),
        check: Callable[[type], None] = lambda law: None,
    ) -> None:
        """Take what its laws are called in messages, the group of entry points, and the laws of
        this package; taken : keys of the scene that no parameter may have; reserved : names that
        are something else; check : raises ValueError where one that comes breaks the contract.
        """
        self._kind = kind
        self._group = group
        self._taken = OF_TABLES | frozenset(taken)
        self._reserved = frozenset(reserved)
        self._check = check
        self._laws = dict(laws)
        self._complete = False
        self.changed: list[Callable[[], None]] = []

    def register(self, name: str) -> Callable[[type], type]:
        """Return the decorator that adds a law under a name.

        It raises ValueError where the name is taken by another, and where the law breaks the
        contract of its kind.
        """

        def add(law: type) -> type:
            before = dict(self._all)
            self._add(name, law)
            try:
                self._tell()
            except Exception as error:
                self._laws = before
                self._tell()
                raise ValueError(f"{self._kind} '{name}': {error}") from error
            return law

        return add

    def forget(self, name: str) -> None:
        """Take a name out again."""
        del self._laws[name]
        self._tell()

    def reserve(self, names: Iterable[str]) -> None:
        """Refuse more names from now on."""
        self._reserved |= frozenset(names)

    def _tell(self):
        for tell in self.changed:
            tell()

    def _add(self, name, law):
        if name in self._reserved or not name.isidentifier():
            raise ValueError(f"{self._kind} '{name}': expected another name, a new word")
        known = self._laws.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (
            law.__module__,
            law.__qualname__,
        ):
            raise ValueError(
                f"{self._kind} '{name}': the name has {known.__qualname__} of {known.__module__},"
                " take another"
            )
        try:
            self._check_parameters(law)
            self._check(law)
        except Exception as error:
            raise ValueError(f"{self._kind} '{name}': {error}") from error
        self._laws[name] = law

    def _check_parameters(self, law):
        for key, entry in parameters(law).items():
            if key in self._taken or key.startswith(("_", "model_")):
                raise ValueError(f"the parameter '{key}' has the name of something else")
            for what in ("default", "example"):
                value = getattr(entry, what)
                if entry.kind[:6] == "number" and value is not None and not _in_range(value, entry):
                    raise ValueError(f"the {what} of '{key}', {value}, is out of its range")

    @property
    def _all(self):
        if not self._complete:
            self._complete = True
            for entry in entry_points(group=self._group):
                self._add(entry.name, entry.load())
        return self._laws

    def __getitem__(self, name: str) -> Any:
        return self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)
