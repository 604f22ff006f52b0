"""The specification of the data format says what the code writes, and so does the package for ROS 2."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from aerial_il.core.lerobot_names import IMAGES
from aerial_il.core.specs import EnvSpec
from aerial_il.data import folder
from aerial_il.data.formats import lerobot, robomimic
from aerial_il.data.formats.parts.lerobot.writing import features_of
from aerial_il.data.provenance import Origin
from aerial_il.data.recording import writer
from aerial_il.data.recording.encoding import messages
from aerial_il.data.recording.form import Form
from aerial_il.data.recording.schema import VERSION, Layout
from aerial_il.suite.scenario import Scenario

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "data_format.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    return re.split(rf"^#+ {re.escape(heading)}$", PAGE, flags=re.MULTILINE)[1].partition("\n##")[0]


def column(heading: str, number: int = 0) -> list[str]:
    """Return what stands in code in a column of the table below a heading."""
    rows = [line.split("|")[1:-1] for line in section(heading).splitlines() if line.startswith("|")][2:]
    return [row[number].strip().strip("`") for row in rows if row[number].strip()]


@pytest.fixture(scope="module")
def spec() -> EnvSpec:
    from aerial_il.suite.environment import AerialEnvironment

    return AerialEnvironment(Scenario("ua_quad_arm4", "reach", "calm", "ee_pose", ("wrist",), (32, 32)), 0).spec


def test_topics_and_types(spec: EnvSpec) -> None:
    form = Form(Layout(spec, 8, {"device": ("a",)}))
    told, written = dict(zip(column("Topics"), column("Topics", 1), strict=True)), {}
    for topic in (form.step, *form.views, *form.cameras):
        name = re.sub(r"^/pose/.*", "/pose/BODY", re.sub(r"^/camera/.*", "/camera/FIELD", topic.name))
        written["/EXTRA" if name == "/device" else name] = topic.type
    assert told == written


def test_the_definition_of_a_message_of_steps() -> None:
    assert messages.STEPS_DEFINITION in PAGE


def test_columns_of_a_step_in_their_order(spec: EnvSpec) -> None:
    assert tuple(column("Steps")) == Layout(spec, 8).row.names


def test_metadata(spec: EnvSpec, tmp_path: Path) -> None:
    from aerial_il.data.recording.scan import scan

    layout = Layout(spec, 8, {"device": ("a",)})
    out = writer.EpisodeWriter(tmp_path / "a.mcap", layout, uid="a", provenance={}, model_xml="<mujoco/>")
    out.finish(np.zeros(1, layout.row), {"wrist_rgb": [b"x"]}, success=True)
    metadata = scan(tmp_path / "a.mcap").metadata
    keys = {key for name in (writer.EPISODE, writer.OUTCOME) for key in metadata[name]}
    assert set(column("Metadata", 1)) == keys
    assert set(column("Metadata")) == {writer.EPISODE, writer.PROVENANCE, writer.OUTCOME}
    assert f"The one attachment is `{writer.MODEL}`" in PAGE


def test_provenance(spec: EnvSpec) -> None:
    origin = Origin(spec=spec, policy="expert", settings={}, model_xml="<mujoco/>", engine="3")
    assert set(column("Provenance")) == set(origin.provenance(0))


def test_folders() -> None:
    told = column("A dataset folder")
    for name in (*folder.KINDS, folder.SALVAGED, "models", "quarantine", "trash"):
        assert f"{name}/" in told
    assert {folder.INDEX, folder.LOG, f"derived/{lerobot.OWN_NAME}"} <= set(told)


def test_features_of_the_lerobot_form(spec: EnvSpec) -> None:
    made = {f"{IMAGES}NAME" if n.startswith(IMAGES) else n for n in features_of(spec, ("wrist_rgb",))}
    assert set(column("Derived: LeRobot")) == made


def test_private_group_of_the_hdf5_form() -> None:
    assert set(column("Derived: HDF5")) == {"actions", *robomimic.EXTRA, "final_state"}
    assert all(f"`{name}`" in section("Derived: HDF5") for name in (*robomimic.COLUMNS, robomimic.DIGEST))


def test_versions() -> None:
    assert f"Version {VERSION} of the schema" in PAGE


PACKAGE = Path(__file__).resolve().parents[3] / "ros2" / "aerial_il_msgs"


def test_its_messages_are_those_of_the_recordings() -> None:
    told = {f"{PACKAGE.name}/msg/{path.stem}": path.read_text(encoding="utf-8") for path in PACKAGE.glob("msg/*")}
    assert told == {messages.STEPS: messages.STEPS_DEFINITION}


def test_every_message_is_built_with_its_dependencies() -> None:
    built = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    assert re.findall(r'"(msg/\w+\.msg)"', built) == [f"msg/{path.name}" for path in sorted(PACKAGE.glob("msg/*"))]
    tree = ET.parse(PACKAGE / "package.xml").getroot()
    assert tree.findtext("name") == PACKAGE.name
    used = {line.split("/")[0] for p in PACKAGE.glob("msg/*") for line in p.read_text().splitlines() if "/" in line}
    depends = {element.text for element in tree.iter("depend")}
    assert {name for name in used if not name.startswith("#")} == depends == {"std_msgs"}
    assert tree.findtext("member_of_group") == "rosidl_interface_packages"
