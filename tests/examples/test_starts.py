"""What ``aerial-il new`` writes of a disturbance, a sensor and a controller keeps their contracts as it is."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core import registry
from aerial_il.data.dataset import open_dataset
from aerial_il.workflows.new import New, new
from tests.contract import test_controllers, test_disturbances, test_formats, test_sensors
from tests.contract.registered import batch, single
from tests.data.crane import CraneBatch, CraneExpert
from tests.examples import plugged_in

CARRIER = """from dataclasses import replace
from aerial_il.robots import quad
ROBOT = replace(quad.ROBOT, name="carrier", sensors={**quad.ROBOT.sensors, "inclinometer": {}})
"""


@contextmanager
def written(kind: str, name: str, top: Path) -> Iterator[None]:
    """Have what is written for ``name`` installed, for a while."""
    (file,) = new(New(kind=kind, name=name, into=str(top))).files  # type: ignore[arg-type]
    assert f"{registry.KINDS[kind].package}.{name}" == ".".join(file.relative_to(top).with_suffix("").parts)
    (file.parent / "carrier.py").write_text(CARRIER)
    with pytest.MonkeyPatch.context() as patch, plugged_in({kind: {name: name}, "robot": {"carrier": "carrier"}}):
        patch.syspath_prepend(str(file.parent))
        yield
    for module in (name, "carrier"):
        sys.modules.pop(module, None)
    batch.cache_clear()
    single.cache_clear()


def test_a_disturbance(tmp_path: Path) -> None:
    with written("disturbance", "shoves", tmp_path):
        test_disturbances.test_settings_are_plain_frozen_and_explained("shoves")
        test_disturbances.test_its_memory_is_of_the_size_that_it_says("shoves")
        test_disturbances.test_kernels_stay_within_their_memory("shoves")
        test_disturbances.test_a_flight_repeats_resumes_and_needs_no_company("shoves")
        test_disturbances.test_what_is_drawn_is_recorded("shoves")


def test_a_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with written("sensor", "inclinometer", tmp_path):
        monkeypatch.setattr(test_sensors, "CELLS", aerial_il.list_cells())
        test_sensors.test_its_fields_are_documented("inclinometer")
        test_sensors.test_it_writes_its_fields_and_nothing_else("inclinometer")
        test_sensors.test_what_it_reads_is_what_is_observed("inclinometer")


@pytest.mark.parametrize("robot", ["ua_quad_arm4", "fa_hexa_arm4"])
def test_a_controller(robot: str, tmp_path: Path) -> None:
    with written("controller", "integrating", tmp_path):
        test_controllers.test_it_says_what_it_is("integrating")
        test_controllers.test_it_brings_the_base_to_its_reference_and_holds_it("integrating", robot)
        test_controllers.test_its_kernel_keeps_to_its_own_memory("integrating", robot)
        assert aerial_il.load(robot, "reach", controller="integrating").spec.controller == "integrating"


def test_a_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with written("format", "flight_json", tmp_path):
        monkeypatch.setattr(test_formats, "NAMES", registry.names("format"))
        episodes = list(open_dataset(collect(CraneBatch(2), CraneExpert(), range(3), tmp_path / "demos").folder.path))
        sample = test_formats.sample("flight_json", episodes, tmp_path)
        test_formats.test_it_defines_what_a_format_must("flight_json")
        test_formats.test_it_recognises_its_own_and_no_other_does("flight_json", {"flight_json": sample})
        test_formats.assert_equal(sample, episodes)
        for damage in ("cut", "garbage"):
            (tmp_path / damage).mkdir()
            test_formats.assert_damage_is_told(sample, damage, 0.3, tmp_path / damage)


def test_a_kernel_that_writes_beyond_its_memory_is_caught(tmp_path: Path) -> None:
    with written("disturbance", "shoves", tmp_path):
        (file,) = tmp_path.rglob("shoves.py")
        file.write_text(file.read_text().replace("memory[PHASE] += own", "memory[2] = 1.0\n    memory[PHASE] += own"))
        sys.modules.pop("shoves", None)
        with pytest.raises((IndexError, AssertionError)):
            test_disturbances.test_kernels_stay_within_their_memory("shoves")
