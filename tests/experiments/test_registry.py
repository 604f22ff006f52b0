"""Every study is found by its folder, asks a question, and takes its settings from the command line."""

from __future__ import annotations

from dataclasses import asdict, fields, is_dataclass
from typing import Any

import pytest

from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.core.errors import UnknownNameError
from experiments.common.report import settings_of

STUDIES = registry.names("study")


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_what_its_folder_says(name: str) -> None:
    study = registry.get("study", name)
    assert study.name == name
    assert study.question.endswith("?")
    assert is_dataclass(study)
    assert fields(study)
    assert study() == study(), "settings are values"


@pytest.mark.parametrize("name", STUDIES)
def test_settings_come_back_from_plain_values(name: str) -> None:
    usual: Any = registry.get("study", name)()
    again = build(type(usual), asdict(usual), base=usual)
    assert settings_of(again) == settings_of(usual)


def test_an_unknown_study_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'tracking'"):
        registry.get("study", "traking")
