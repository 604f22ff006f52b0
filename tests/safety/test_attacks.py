"""Whatever a command opens: nothing in it is run, nothing outside touched, little spent; also of mutated files."""

import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.data.formats.parts import hdf5_probe
from tests.safety import fuzz
from tests.safety.bounds import MAX_BYTES, MAX_CPU_S, peak
from tests.safety.fuzz import ALL, GOOD, Target, outcomes, sound
from tests.safety.hostile import ATTACKS, SCRIPT, Sound, trace
from tests.safety.openings import beside, keys, words

OWN = {  # kind of what is attacked, as the attack's name begins -> where it is opened first
    "policy": [("evaluate", "policy")],
    "safetensors": [("evaluate", "policy")],
    "run": [("report", "run"), ("runs", "folder"), ("train", "run"), ("train", "from")],
    "index": [("validate", "path"), ("collect", "out")],
    "recordings": [("validate", "path"), ("collect", "out"), ("recover", "path")],
    "mcap": [("validate", "path")],
    "hdf5": [("validate", "path"), ("train", "dataset")],
    "lerobot": [("validate", "path"), ("train", "dataset")],
    "minari": [("validate", "path"), ("train", "dataset"), ("convert", "path")],
    "evaluation": [("compare", "result"), ("report", "result")],
    "wrong": [("info", "path"), ("evaluate", "policy")],
    "a_loop": [("info", "path"), ("evaluate", "policy")],
}
EVERYWHERE = ("policy_pickled", "index_of_tags")  # against every key, by default
FIRST = [(*key, attack) for attack in ATTACKS for kind, at in OWN.items() if attack.startswith(kind) for key in at]
FIRST += [(*key, attack) for attack in EVERYWHERE for key in keys() if (*key, attack) not in FIRST]
REST = [(*key, attack) for key in keys() for attack in ATTACKS if (*key, attack) not in FIRST]


def test_every_key_that_opens_something_says_how(sound: Sound) -> None:
    """A new command, or a new key for a place, is to be told to ``openings.py``, and is attacked from then on."""
    assert sorted(beside(sound)) == sorted(keys())
    assert {attack for _, _, attack in FIRST} == set(ATTACKS)


@pytest.mark.parametrize(("name", "key", "attack"), FIRST)
def test_attack(
    name: str, key: str, attack: str, sound: Sound, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    _attack(words(name, key, ATTACKS[attack](sound, tmp_path / "hostile"), sound), sound, tmp_path, monkeypatch, capfd)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "key", "attack"), REST)
def test_attack_elsewhere(
    name: str, key: str, attack: str, sound: Sound, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    _attack(words(name, key, ATTACKS[attack](sound, tmp_path / "hostile"), sound), sound, tmp_path, monkeypatch, capfd)


def test_the_attacks_would_succeed_on_a_careless_reader(sound: Sound, tmp_path: Path) -> None:
    import pickle

    import numpy as np
    import yaml

    careless = [
        lambda: pickle.loads((ATTACKS["policy_pickled"](sound, tmp_path / "a") / "policy/state.json").read_bytes()),
        lambda: yaml.unsafe_load((ATTACKS["index_of_tags"](sound, tmp_path / "b") / "dataset.yaml").read_text()),
        lambda: np.load(ATTACKS["policy_npz_of_objects"](sound, tmp_path / "c"), allow_pickle=True)["told"],
    ]
    for read in careless:
        read()
        assert sound.canary.exists()
        sound.canary.unlink()


def _attack(
    typed: list[str], sound: Sound, home: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(home)
    monkeypatch.syspath_prepend(sound.run.parent)  # a name that is imported is found there
    before, base = trace(sound.victim), peak(reset=True)
    started = time.process_time()
    status = main(typed)
    spent, grown = time.process_time() - started, peak() - base
    said = "".join(capfd.readouterr())
    assert status in (0, 1, 2), said
    assert not sound.canary.exists(), "code out of a file was run"
    assert "bait" not in sys.modules
    assert trace(sound.victim) == before, "something outside was changed"
    assert "precious words" not in said
    assert not any(SCRIPT in page.read_text() for page in _pages(home)), "a name became markup"
    assert grown < MAX_BYTES, f"{grown >> 20} MB"
    if status:
        assert spent < MAX_CPU_S, f"{spent:.1f} s before: {said}"
        assert re.search(r"\baerial-il: ", said), said


def _pages(home: Path) -> list[Path]:
    return [page for ending in ("html", "svg") for page in home.rglob(f"*.{ending}") if page.is_file()]


SHARE = {"mcap": 100, "lerobot": 20, "hdf5": 8, "run": 20}


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return sound(tmp_path_factory.mktemp("fuzz") / "sound")


@pytest.mark.parametrize("kind", ALL)
def test_a_mutated_file_is_refused_or_read_as_it_was(kind: str, targets: dict[str, Target], tmp_path: Path) -> None:
    result = Counter(said for _, said in outcomes(kind, range(SHARE[kind]), targets[kind], tmp_path))
    assert set(result) <= set(GOOD), result
    assert result["refused"]


def test_a_careless_reader_would_be_seen(targets: dict[str, Target], tmp_path: Path) -> None:
    careless = replace(targets["mcap"], read=lambda path: path.read_bytes())
    assert Counter(said for _, said in outcomes("mcap", range(5), careless, tmp_path)) == {"changed": 5}
    fragile = replace(targets["mcap"], read=lambda path: 1 // (path.parent.name == "whole"))
    assert Counter(said for _, said in outcomes("mcap", range(2), fragile, tmp_path)) == {
        "untyped ZeroDivisionError": 2
    }


def test_a_copy_of_the_process_probes_a_file_as_a_new_one_does(
    targets: dict[str, Target], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, torn = targets["hdf5"].path, tmp_path / "torn.hdf5"
    torn.write_bytes(b"torn")

    def found(look_at: Callable[[Iterable[Path]], None]) -> list[bool]:
        hdf5_probe.ended.clear()
        look_at([torn, path])
        return [hdf5_probe.ended[hdf5_probe.known_by(each)] >= 0 for each in (path, torn)]

    assert found(fuzz.look_at) == found(hdf5_probe.look_at) == [True, True]
    dies = "def probe(path):\n    b'torn' in os.fsencode(path) and os.kill(os.getpid(), 24)  # SIGXCPU"
    for name in ("PROBE", "PROGRAM"):
        monkeypatch.setattr(hdf5_probe, name, getattr(hdf5_probe, name).replace("def probe(path):", dies))
    assert found(fuzz.look_at) == found(hdf5_probe.look_at) == [True, False], "and the next file is looked at"


@pytest.mark.slow
@pytest.mark.parametrize("number", [368, 986])
def test_a_file_in_which_hdf5_stays_for_ever_is_refused(
    number: int, targets: dict[str, Target], tmp_path: Path
) -> None:
    """Mutations that ``make fuzz`` found: in the second, what comes before the place raises."""
    ((_, result),) = outcomes("hdf5", range(number, number + 1), targets["hdf5"], tmp_path)
    assert result == "refused"


@pytest.mark.slow
def test_a_file_of_many_demonstrations_is_not_called_damaged(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "many.hdf5", "w") as file:
        for demo in range(600):
            for name in ("actions", *(f"obs/f{i}" for i in range(10)), *(f"next_obs/f{i}" for i in range(10))):
                file[f"data/demo_{demo}/{name}"] = np.zeros((60, 3))
    hdf5_probe.require_readable(tmp_path / "many.hdf5")
