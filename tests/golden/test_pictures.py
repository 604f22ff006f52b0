"""One seeded frame per cell and camera, judged by what any renderer must agree on: what is where, how far, how bright.

Pixels differ between graphics drivers in the last bit, so none is compared.
"""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.suite.environment import AerialEnvironment
from tests.contract.registered import CELLS, SAMPLE, drawn

SEED, HEIGHT, WIDTH = 3, 120, 160
CAMERAS = ("scene", "wrist", "base")
pytestmark = pytest.mark.render
each_view = pytest.mark.parametrize(
    ("cell", "camera"),
    [
        pytest.param(cell, camera, marks=() if cell in SAMPLE else pytest.mark.slow)
        for cell in CELLS
        for camera in CAMERAS
    ],
)


@pytest.fixture
def env(cell: tuple[str, str]) -> AerialEnvironment:
    world = drawn(*cell)
    world.reset(seed=SEED)
    return world


@each_view
def test_a_picture_is_neither_dark_nor_burnt_out_nor_empty(env: AerialEnvironment, camera: str) -> None:
    image = env.render(camera, HEIGHT, WIDTH)
    assert (image.shape, image.dtype) == ((HEIGHT, WIDTH, 3), np.uint8)
    grey = image.mean(axis=2)
    assert 90.0 < grey.mean() < 220.0
    assert (grey > 250.0).mean() < 0.1
    assert (grey < 5.0).mean() < 0.05
    assert len(np.unique(grey.astype(int))) > 10  # a base on its skids sees little but floor


@each_view
def test_depth_is_in_metres_and_agrees_with_the_segmentation(env: AerialEnvironment, camera: str) -> None:
    depth = env.render(camera, HEIGHT, WIDTH, "depth")
    geoms = env.render(camera, HEIGHT, WIDTH, "segmentation")
    assert (depth.shape, depth.dtype) == ((HEIGHT, WIDTH), np.float32)
    assert (geoms.shape, geoms.dtype) == ((HEIGHT, WIDTH), np.int32)
    model, data = env.physics.model.ptr, env.physics.data.ptr
    assert geoms.max() < model.ngeom
    view = data.camera(camera)
    for geom in np.unique(geoms[geoms >= 0]):
        if (geoms == geom).sum() < 5 or model.geom(geom).name == "ground":
            continue
        ahead = (data.geom_xpos[geom] - view.xpos) @ -view.xmat.reshape(3, 3)[:, 2]
        nearest, reach = np.median(depth[geoms == geom]), model.geom_rbound[geom]
        assert abs(nearest - ahead) <= reach + 0.05, (
            f"{model.geom(geom).name} is {ahead:.2f} m ahead, depth says {nearest:.2f}"
        )


@each_view
def test_the_same_state_gives_the_same_picture(env: AerialEnvironment, camera: str) -> None:
    image = env.render(camera, HEIGHT, WIDTH)
    again = env.render(camera, HEIGHT, WIDTH)
    assert np.abs(again.astype(int) - image).max() <= 1, "software renderers round the last bit as they please"
    assert (again != image).mean() < 0.1
    for _ in range(25):
        env.step(env.action_spec().maximum)
    assert (np.abs(env.render(camera, HEIGHT, WIDTH).astype(int) - image) > 8).mean() > 0.003


@pytest.mark.parametrize("cell", [cell for cell in CELLS if cell[1] == "pick_place"])
def test_the_props_have_the_colours_of_the_instruction(env: AerialEnvironment, cell: tuple[str, str]) -> None:
    image, geoms = env.render("scene", 240, 320), env.render("scene", 240, 320, "segmentation")
    model = env.physics.model.ptr
    red, _, blue = image[geoms == model.geom("cube").id].mean(axis=0)
    assert red > 2.0 * blue, "the cube is orange"
    walls = [model.geom(f"bowl_wall_{i}").id for i in range(8)]
    red, _, blue = image[np.isin(geoms, walls)].mean(axis=0)
    assert blue > 1.5 * red, "the bowl is blue"
    assert "orange cube" in env.spec.instruction
    assert "blue bowl" in env.spec.instruction
