"""Photo, mask, id map and camera of a rendered view agree with one another."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

import mattgs_ops
from mattgs_ops.errors import InputError
from mattgs_ops.synthetic import cameras, render
from mattgs_ops.synthetic.objects import parts
from mattgs_ops.synthetic.render import (
    Making,
    World,
    develop,
    photograph,
    plan_views,
    render_capture,
    save_transforms,
)
from mattgs_ops.synthetic.surfaces.materials import Part, Stage, plain, pose
from mattgs_ops.synthetic.surfaces.mesh import box, quad
from mattgs_ops.synthetic.surroundings import clutter
from mattgs_ops.synthetic.surroundings.desk import Layout, Occupancy, scatter
from mattgs_ops.synthetic.surroundings.item import Item
from mattgs_ops.synthetic.tracer import Layers, Lens, Tracer, choose_variant, room_light

BUNDLED = Path(mattgs_ops.__file__).parent / "bundled"
WIDTH, HEIGHT = 64, 48
ORBIT = (cameras.Orbit(35, 22, 1),)


@pytest.fixture(scope="module")
def stage() -> Stage:
    """Return a red box with a screw, a wire and a label on a grey table."""
    out = Stage()
    out.add(quad(80, 80), plain("808080"), own=False)
    solid = box(5, 4, 3, 0.1)
    out.add(solid, plain("d02010"), own=True)
    parts.screw(0.9).place(out, pose(1.4, 1, 3), own=True)
    parts.wire([[-2, 2, 0.4], [-2, 3.5, 2], [1, 3.8, 0.4]], 0.25, "1020e0").place(
        out, np.eye(4), own=True
    )
    label = parts.decal(["XX"], 2.4, 2.4, (240, 240, 240), (10, 10, 10), 20)
    label.place(out, pose(-0.9, 0, 3), own=True)
    out.corners.append(solid.vertices)
    return out


@pytest.fixture(scope="module")
def tracer(stage: Stage) -> Tracer:
    assert choose_variant("scalar_rgb") == "scalar_rgb"
    return Tracer(stage, room_light())


@pytest.fixture(scope="module")
def poses() -> list[np.ndarray]:
    return cameras.walk(ORBIT, np.array([0.0, 0, 1.5]), 2, np.random.default_rng(3))


@pytest.fixture(scope="module")
def layers(tracer: Tracer, poses: list[np.ndarray]) -> list[Layers]:
    return [tracer.layers(pose, WIDTH, HEIGHT) for pose in poses]


def test_known_corners_lie_in_the_mask_and_where_the_render_has_them(
    stage: Stage, poses: list[np.ndarray], layers: list[Layers]
) -> None:
    corners = stage.corners[0]
    for to_world, layer in zip(poses, layers, strict=True):
        camera = cameras.camera(to_world, WIDTH, HEIGHT)
        pixels, depth = camera.project(corners)
        assert (depth > 0).all()
        columns, rows = np.floor(pixels).astype(int).T
        near_mask = cv2.dilate((layer.coverage > 0).astype(np.uint8), np.ones((3, 3), np.uint8))
        assert near_mask[rows, columns].all()
        # a pixel is about 22 / 60 cm wide: corners that are seen are that near to what it shows
        seen = layer.position[rows, columns]
        distance = np.linalg.norm(seen - corners, axis=1)
        hidden = np.linalg.norm(seen - camera.centre, axis=1) < depth - 1.0
        assert (distance[~hidden] < 1.0).mean() > 0.6
        assert (~hidden).sum() >= 9  # three of the faces are seen


def test_every_pixel_shows_a_point_that_projects_into_it(
    poses: list[np.ndarray], layers: list[Layers]
) -> None:
    for to_world, layer in zip(poses, layers, strict=True):
        rows, columns = np.nonzero(np.isfinite(layer.position).all(axis=2))
        camera = cameras.camera(to_world, WIDTH, HEIGHT)
        pixels, _ = camera.project(layer.position[rows, columns].astype(np.float64))
        middle = np.column_stack([columns, rows]) + 0.5
        assert len(rows) > WIDTH * HEIGHT / 2
        assert np.abs(pixels - middle).max() < 0.02


def test_the_photo_shows_the_object_where_the_mask_is(
    tracer: Tracer, poses: list[np.ndarray], layers: list[Layers]
) -> None:
    photo = photograph(tracer, poses[0], WIDTH, HEIGHT, 4, 0, 1.0).astype(int)
    red = photo[..., 0] - photo[..., 1]
    plain_part = layers[0].part == Part.REST
    inside = (layers[0].coverage == 1) & plain_part
    assert 0.05 < (layers[0].coverage >= 0.5).mean() < 0.5
    assert np.percentile(red[inside], 20) > 40
    assert np.percentile(np.abs(red[layers[0].coverage == 0]), 80) < 30


def test_a_lens_blurs_what_it_is_not_focused_on(tracer: Tracer, poses: list[np.ndarray]) -> None:
    def sharpness(lens: Lens | None) -> float:
        light = tracer.render(poses[0], WIDTH, HEIGHT, 64, 0, lens)["light"]
        return float(np.square(np.diff(light.mean(axis=2), axis=1)).mean())

    distance = float(np.linalg.norm(poses[0][:3, 3] - [0, 0, 1.5]))
    sharp = sharpness(None)
    assert sharpness(Lens(0.1, distance)) > 0.9 * sharp
    assert sharpness(Lens(3.0, 4 * distance)) < 0.7 * sharp


@pytest.mark.parametrize("grid", [1, 3])
def test_a_coarser_grid_shows_the_same_with_fewer_samples(
    tracer: Tracer, poses: list[np.ndarray], layers: list[Layers], grid: int
) -> None:
    coarse = tracer.layers(poses[0], WIDTH, HEIGHT, grid)
    steps = coarse.coverage * grid**2
    assert np.abs(steps - np.rint(steps)).max() < 1e-5
    assert np.abs(coarse.coverage - layers[0].coverage).mean() < 0.03
    assert np.allclose(coarse.position, layers[0].position, equal_nan=True, atol=1e-3)


def test_small_structures_are_marked(layers: list[Layers]) -> None:
    for part in (Part.SCREW, Part.WIRE, Part.PRINT):
        assert any((layer.part == part).sum() >= 3 for layer in layers), part
    for layer in layers:
        assert (layer.coverage[layer.part > 0] > 0).all()


def test_same_seed_same_photo_another_seed_another_noise(
    tracer: Tracer, poses: list[np.ndarray]
) -> None:
    first, again, other = (tracer.render(poses[0], 32, 24, 4, seed)["light"] for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_walk_is_repeatable_and_looks_at_the_object() -> None:
    target = np.array([0.0, 0, 5])
    orbits = (cameras.Orbit(20, 50, 3), cameras.Orbit(50, 40, 1))
    poses = cameras.walk(orbits, target, 16, np.random.default_rng(1))
    again = cameras.walk(orbits, target, 16, np.random.default_rng(1))
    assert np.array_equal(poses, again)
    assert len(poses) == 16
    for to_world in poses:
        pixel, depth = cameras.camera(to_world, 640, 480).project(target[None])
        assert depth[0] > 30
        assert np.abs(pixel - [320, 240]).max() < 60
        assert np.allclose(to_world[:3, :3].T @ to_world[:3, :3], np.eye(3))


def test_things_are_laid_beside_the_object_and_apart_from_one_another() -> None:
    stage, space = Stage(), Occupancy(100, 80)
    space.take_disc(10)
    before = space.taken.sum()
    limit = Layout(clear=10, reach=30, tone=(0, 0, 0), slope=0.2)
    makes = [clutter.pen, clutter.battery, clutter.pencil, clutter.screwdriver] * 4
    scatter(stage, np.random.default_rng(0), space, makes, 12, 30, limit=limit)
    points = np.concatenate([mesh.vertices for mesh, _, _, own in stage.merged() if not own])
    radius = np.linalg.norm(points[:, :2], axis=1)
    assert radius.min() > 9
    assert np.abs(points[:, :2]).max(axis=0).tolist() < [50.0, 40.0]
    # a screwdriver is 2.4 high: none nearer than that allows
    assert radius[points[:, 2] > 2.5].min() > 2.4 / 0.2 + 5 - 19 / 2
    assert space.taken.sum() > before


def test_nothing_is_put_where_something_stands() -> None:
    space = Occupancy(100, 100)
    space.take_disc(10)
    assert not space.try_take(5, 5, Item(4, 4, 1), 30)
    assert not space.try_take(20, 0, Item(4, 4, 1), 0, keep=30)
    assert space.try_take(20, 0, Item(4, 4, 1), 0)
    assert not space.try_take(21, 1, Item(4, 4, 1), 45)
    assert not space.try_take(60, 0, Item(4, 4, 1), 0)


def test_light_is_developed_to_srgb() -> None:
    light = np.array([[[0.0, 1e3, np.log(2)]]], dtype=np.float32)
    # half the light is sRGB 188
    assert develop(light, 1.0).tolist() == [[[0, 255, 188]]]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "castle"}, "'castle': expected one of rover"),
        ({"name": "rover", "views": 0}, "views: expected a positive number, found 0"),
        ({"name": "rover", "test_views": -1}, "test_views: expected no negative number"),
        ({"name": "rover", "seed": -1}, "seed: expected no negative number, found -1"),
    ],
)
def test_bad_requests_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Making(**options)


def test_a_capture_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").touch()
    with pytest.raises(InputError, match="found transforms"):
        render_capture(Making("rover"), tmp_path)


def test_test_views_are_of_a_walk_of_their_own_as_in_the_shipped_capture() -> None:
    many = plan_views(Making("lattepanda"))
    train, test = many[:48], many[48:]
    shipped = json.loads((BUNDLED / "lattepanda" / "transforms.json").read_text(encoding="utf-8"))
    for frame, view in zip(shipped["frames"], many, strict=True):
        assert frame["file_path"] == f"images/{view.file}"
        assert np.allclose(frame["transform_matrix"], view.pose)
    places = np.array([view.pose[:3, 3] for view in train])
    assert len(test) == 24
    for view in test:
        assert np.linalg.norm(places - view.pose[:3, 3], axis=1).min() > 0.1  # centimetres
    assert len({view.seed for view in many}) == len({view.file for view in many}) == 72
    assert len({view.exposure for view in train}) == 48
    assert len({view.exposure for view in test}) == 1


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return a small capture that was interrupted after two of its three views.

    Its desk is bare: painting all that lies on one takes many times as long as the views.
    """
    out = tmp_path_factory.mktemp("capture") / "lattepanda"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "furnish", bare_desk)
        with pytest.raises(KeyboardInterrupt):
            render_capture(SMALL, out, variant="scalar_rgb", progress=interrupt)
        yield out


SMALL = Making("lattepanda", views=2, test_views=1, width=64, height=48, samples=1, test_samples=2)


def bare_desk(stage: Stage, *_: object) -> float:
    stage.add(quad(170, 150), plain("808080"), own=False)
    return 0.0


def interrupt(done: int, total: int, _text: str = "") -> None:
    """Stand for the user's Ctrl-C after the second of three views."""
    if (done, total) == (2, 3):
        raise KeyboardInterrupt


def test_an_interrupted_rendering_goes_on_and_ends_with_the_split(capture: Path) -> None:
    assert not (capture / "transforms.json").exists()
    with pytest.raises(InputError, match=r"expected a capture made with seed 1, found seed 0$"):
        render_capture(replace(SMALL, seed=1), capture, variant="scalar_rgb")
    before = {path: path.stat().st_mtime_ns for path in capture.glob("images/*")}
    render_capture(SMALL, capture, variant="scalar_rgb")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    transforms = json.loads((capture / "transforms.json").read_text(encoding="utf-8"))
    assert transforms["train_filenames"] == ["images/0000.jpg", "images/0001.jpg"]
    assert transforms["test_filenames"] == ["images/test_0000.jpg"]
    for frame in transforms["frames"]:
        assert (capture / frame["file_path"]).is_file()
        mask = np.asarray(Image.open(capture / frame["mask_path"]))
        assert ((mask > 0) & (mask < 255)).any(), "coverage, not only in or out"
    assert [path.name for path in (capture / "ids").iterdir()] == ["test_0000.jpg.png"]


def test_a_kill_while_a_listing_is_written_leaves_the_one_before(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listing, write = tmp_path / "transforms.json", Path.write_text
    save_transforms([], 64, 48, listing)
    before = listing.read_text()

    def killed(path: Path, data: str, **options: str) -> int:
        write(path, data[:5], **options)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_text", killed)
    with pytest.raises(KeyboardInterrupt):
        save_transforms([{"file_path": "a.jpg"}], 64, 48, listing)
    with pytest.raises(KeyboardInterrupt):
        render._begin(World(stage, 0.0, 1.0, []), {"name": "rover"}, tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["transforms.json"]
    assert listing.read_text() == before
