"""Fields that the data of others name otherwise than the environment does in which their policy flies."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from aerial_il.core.specs import EnvSpec, Field, ObservationSpec


def shown_for(spec: EnvSpec, names: Sequence[str], there: EnvSpec) -> dict[str, str]:
    """Return field of a policy -> the field of the environment that stands for it under another name.

    Only where either side has one single field of that shape without a counterpart: nothing is guessed apart.

    Args:
        spec: of the data that the policy learned from. names: of the fields that it sees. there: of the environment.
    """
    lacking = [spec.observation[name] for name in names if name not in there.observation.names]
    spare = [field for field in there.observation.fields if field.name not in names]
    alike = {field.name: [other.name for other in spare if _kind(other) == _kind(field)] for field in lacking}
    rivals = [_kind(field) for field in lacking]
    return {
        field.name: alike[field.name][0]
        for field in lacking
        if len(alike[field.name]) == rivals.count(_kind(field)) == 1
    }


def under_their_names(spec: EnvSpec, shown: Mapping[str, str]) -> EnvSpec:
    """Return the specification of an environment with its fields called as a policy of others knows them."""
    theirs = {name: own for own, name in shown.items()}
    fields = (replace(field, name=theirs.get(field.name, field.name)) for field in spec.observation.fields)
    return replace(spec, observation=ObservationSpec(tuple(fields)))


def _kind(field: Field) -> tuple[tuple[int, ...], bool]:
    return field.shape, field.group == "image"
