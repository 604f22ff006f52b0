"""Each finding of ``aerial-il doctor`` is explained, and it says what is wrong where something is."""

import re
from pathlib import Path
from typing import Any

import pytest

from aerial_il.workflows import doctor

ROOT = Path(__file__).resolve().parents[3]
SOUND: dict[str, Any] = {
    "packages": dict.fromkeys(doctor.PACKAGES_NEEDED, "1.0"),
    "git": {"sha": "0", "dirty": False},
    "python": "3.12.1",
    "platform": "Linux x86_64",
    "cpu_count": 2,
    "rendering": {"chosen": "egl", "egl": "works", "osmesa": "AttributeError"},
    "free_disk_gb": 50.0,
}


def test_every_finding_has_an_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aerial_il.core.rendering.probe_backend", lambda _: "")
    text = (ROOT / doctor.PAGE).read_text(encoding="utf-8").split("## What doctor finds")[1].split("\n## ")[0]
    assert re.findall(r"^### (\S+)$", text, flags=re.MULTILINE) == list(doctor.findings())


def test_a_sound_machine_gets_no_advice() -> None:
    assert doctor.advice(SOUND) == {}


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("packages", {"numpy": "2.2"}, "torch, lerobot is not installed"),
        ("git", {"sha": "0", "dirty": True}, "commit before a study"),
        ("platform", "Darwin arm64", "Only Linux"),
        ("cpu_count", 1, "One core"),
        ("rendering", {"chosen": "disabled", "egl": "no", "osmesa": "no"}, "apt-get install"),
        ("rendering", {"chosen": "osmesa", "egl": "works", "osmesa": "no"}, "another does"),
        ("free_disk_gb", 1.0, "Little is left"),
    ],
)
def test_what_is_not_as_it_could_be_is_told(name: str, value: Any, said: str) -> None:
    assert said in doctor.advice({**SOUND, name: value})[name]
