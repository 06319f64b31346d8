"""The stage in Mitsuba 3: light, path tracing, and exact layers of what each pixel shows.

The fastest variant that runs here is used: ``llvm_ad_rgb`` where an LLVM library of version 17 or
newer is found (the older ones that were tried abort), else ``scalar_rgb``. Both compute the same
light; their noise differs, so one seed gives the same images per variant only.
"""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import StageError
from mattgs_ops.synthetic.cameras import FOCAL
from mattgs_ops.synthetic.surfaces.atlas import Sheet, pack
from mattgs_ops.synthetic.surfaces.materials import Part, Stage
from mattgs_ops.synthetic.surfaces.mesh import Array, write_ply

DEPTH = 4  # bounces of light, the last into the lamp included
GRID = 5  # samples per pixel and direction of the layers
LLVM_VERSIONS = range(22, 16, -1)  # 15 aborts on the principled model, 16 does with AVX-512
LIBRARY_FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64")
BACKGROUND = -1


@dataclass(frozen=True)
class Lens:
    """A thin lens: ``aperture`` is its radius, ``focus`` the distance of what is sharp, cm."""

    aperture: float
    focus: float


@dataclass(frozen=True)
class Layers:
    """What a view's pixels show, supersampled on a grid.

    ``coverage`` [H, W] float32: share of the pixel that the object covers; ``part`` [H, W] uint8:
    the small structure (:class:`Part`) covering most of the pixel; ``position`` [H, W, 3]
    float32: where the pixel's centre hits, nan where nothing.
    """

    coverage: NDArray[np.float32]
    part: NDArray[np.uint8]
    position: NDArray[np.float32]


def choose_variant(wanted: str | None = None) -> str:
    """Set and return Mitsuba's variant; raises :class:`StageError` when it is not installed."""
    try:
        if wanted in (None, "llvm_ad_rgb") and _find_llvm():
            wanted = "llvm_ad_rgb"
        import mitsuba as mi
    except ImportError as error:
        raise StageError(
            "rendering captures needs Mitsuba 3: install the `captures` extra "
            "(pip install 'mattgs-bench[captures]')"
        ) from error
    variant = wanted or "scalar_rgb"
    mi.set_variant(variant)
    return variant


def _find_llvm() -> bool:
    """Point Dr.Jit at a new enough LLVM library; leave a user's own choice alone."""
    if os.environ.get("DRJIT_LIBLLVM_PATH"):
        return True
    names = [name for v in LLVM_VERSIONS for name in (f"libLLVM.so.{v}.1", f"libLLVM-{v}.so")]
    for name in names:
        for folder in LIBRARY_FOLDERS:
            path = Path(folder) / name
            if path.exists():
                os.environ["DRJIT_LIBLLVM_PATH"] = str(path)
                return True
    return False


class Tracer:
    """A stage loaded into Mitsuba.

    Surfaces that another tracer has ``loaded`` already are taken from there: preparing their
    images is half of the work.
    """

    def __init__(self, stage: Stage, light: dict[str, Any], loaded: "Tracer | None" = None) -> None:
        import mitsuba as mi

        self.sheets = pack(stage)
        entries: dict[str, Any] = {"type": "scene"}
        with tempfile.TemporaryDirectory(prefix="mattgs-meshes-") as folder:
            for k, sheet in enumerate(self.sheets):
                path = Path(folder) / f"{k:04d}.ply"
                # u counts the sheets: Mitsuba numbers shapes in an order of its own
                write_ply(sheet.mesh.with_uv(k, 0, k + 1, 1), path)
                entries[f"a{k:04d}"] = {
                    "type": "ply",
                    "filename": str(path),
                    "bsdf": (loaded and loaded._surface_of(sheet)) or _surface(sheet),
                }
            self.scene = mi.load_dict(entries | light)

    def _surface_of(self, wanted: Sheet) -> Any:
        """Return the loaded surface of a sheet that looks the same; None where there is none."""
        surfaces = {shape.id(): shape.bsdf() for shape in self.scene.shapes()}
        for k, sheet in enumerate(self.sheets):
            if sheet.finish == wanted.finish and np.array_equal(sheet.image, wanted.image):
                return surfaces[f"a{k:04d}"]
        return None

    def move_lamp(self, name: str, place: Array) -> None:
        """Move a point light of the stage to ``place`` [3]."""
        import mitsuba as mi

        values = mi.traverse(self.scene)
        values[f"{name}.position"] = [float(v) for v in place]
        values.update()

    def render(
        self,
        camera_to_world: Array,
        width: int,
        height: int,
        samples: int,
        seed: int,
        lens: Lens | None = None,
    ) -> dict[str, NDArray[np.float32]]:
        """Trace a view; linear ``light``, ``albedo`` and ``normal``, each [H, W, 3].

        Without a ``lens`` everything is in focus.
        """
        import mitsuba as mi

        integrator = mi.load_dict(
            {
                "type": "aov",
                "aovs": "albedo:albedo,normal:sh_normal",
                "image": {"type": "path", "max_depth": DEPTH},
            }
        )
        sensor = _sensor(camera_to_world, width, height, samples, "multijitter", lens)
        out = np.array(mi.render(self.scene, sensor=sensor, integrator=integrator, seed=seed))
        out = np.nan_to_num(out.astype(np.float32), posinf=0.0, neginf=0.0)
        return {
            "light": out[..., :3],
            "albedo": out[..., -6:-3],
            "normal": out[..., -3:],
        }

    def layers(self, camera_to_world: Array, width: int, height: int, grid: int = GRID) -> Layers:
        """Find what each pixel shows, exactly but for the sampling on a regular grid.

        ``grid`` is odd, so that one sample is in the middle of each pixel.
        """
        import mitsuba as mi

        kinds = {"type": "aov", "aovs": "face:prim_index,uv:uv,xyz:position"}
        sensor = _sensor(camera_to_world, width * grid, height * grid, 1, "grid")
        integrator = mi.load_dict(kinds)
        out = np.array(mi.render(self.scene, sensor=sensor, integrator=integrator, seed=0))
        hit = np.isfinite(out).all(axis=2) & (np.abs(out[..., 3:6]).sum(axis=2) > 0)
        sheet = np.where(hit, np.floor(out[..., 1]), BACKGROUND).astype(np.int64)
        own, part = self._object_and_parts(
            sheet, np.rint(out[..., 0]).astype(np.int64), out[..., 1:3] % 1
        )
        coverage = own.reshape(height, grid, width, grid).mean(axis=(1, 3), dtype=np.float32)
        position = np.where(hit[..., None], out[..., 3:6], np.nan).astype(np.float32)
        centre = grid // 2
        return Layers(coverage, _majority(part, grid), position[centre::grid, centre::grid])

    def _object_and_parts(
        self, which: NDArray[np.int64], face: NDArray[np.int64], uv: NDArray[np.float32]
    ) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
        """Return for each sample whether it shows the object, and which small structure."""
        own = np.zeros(which.shape, dtype=bool)
        part = np.zeros(which.shape, dtype=np.uint8)
        for k, sheet in enumerate(self.sheets):
            here = np.nonzero(which == k)
            faces = face[here]
            height, width = sheet.ink.shape
            u, v = uv[here].T
            i = np.clip((v * height).astype(int), 0, height - 1)
            j = np.clip((u * width).astype(int), 0, width - 1)
            own[here] = sheet.own[faces]
            part[here] = np.where(sheet.ink[i, j], Part.PRINT, sheet.part[faces])
        return own, part * own


def _majority(part: NDArray[np.uint8], grid: int) -> NDArray[np.uint8]:
    height, width = part.shape[0] // grid, part.shape[1] // grid
    blocks = part.reshape(height, grid, width, grid)
    counts = np.stack([(blocks == kind).sum(axis=(1, 3)) for kind in Part])
    # a wire a pixel wide rarely fills half of one: a quarter is enough for a small structure
    small = counts[1:].max(axis=0) * 4 >= grid * grid
    return np.where(small, counts[1:].argmax(axis=0) + 1, 0).astype(np.uint8)


def _surface(sheet: Sheet) -> dict[str, Any]:
    import mitsuba as mi

    roughness, metallic, specular = sheet.finish
    bitmap = mi.Bitmap(np.ascontiguousarray(sheet.image))
    return {
        "type": "principled",
        "base_color": {"type": "bitmap", "bitmap": bitmap, "wrap_mode": "repeat"},
        "roughness": roughness,
        "metallic": metallic,
        "specular": specular,
    }


def _sensor(
    camera_to_world: Array,
    width: int,
    height: int,
    samples: int,
    sampling: str,
    lens: Lens | None = None,
) -> Any:
    import mitsuba as mi

    # Mitsuba looks along +z with x to the left, OpenGL along -z with x to the right
    matrix = camera_to_world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
    # one sample in the middle of each cell of the supersampled grid: stratified without jitter
    sampler = (
        {"type": "stratified", "sample_count": 1, "jitter": False}
        if sampling == "grid"
        else {"type": sampling, "sample_count": samples}
    )
    kind: dict[str, Any] = {"type": "perspective"}
    if lens is not None:
        kind = {
            "type": "thinlens",
            "aperture_radius": lens.aperture,
            "focus_distance": lens.focus,
        }
    return mi.load_dict(
        {
            **kind,
            "fov": float(2 * np.degrees(np.arctan(0.5 / FOCAL))),
            "fov_axis": "x",
            "near_clip": 0.5,
            "far_clip": 2000.0,
            "to_world": mi.ScalarTransform4f(matrix.tolist()),
            "film": film,
            "sampler": sampler,
        }
    )


def room_light(strength: float = 1.0, turn: float = 0.0) -> dict[str, Any]:
    """Return the light of a room: a bright ceiling with two panels, and a window to one side.

    ``turn`` in degrees puts the window elsewhere.
    """
    import mitsuba as mi

    height, width = 64, 128
    up = np.cos(np.linspace(0, np.pi, height))[:, None]  # the map's rows run from +y down
    around = np.linspace(0, 360, width)[None]
    sky = np.where(up > 0, 0.35 + 0.35 * up, 0.12)[..., None] * np.array([1.0, 0.97, 0.92])
    for centre, colour in ((70, (3.4, 3.2, 2.9)), (235, (2.6, 2.5, 2.4))):
        panel = (np.abs(around - centre) < 24) & (up > 0.74) & (up < 0.95)
        sky = np.where(panel[..., None], np.array(colour), sky)
    bitmap = mi.Bitmap((strength * sky).astype(np.float32))
    frame = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    angle = np.radians(turn)
    place = [150 * np.cos(angle), 150 * np.sin(angle), 125.0]
    window = mi.ScalarTransform4f().look_at(place, [0, 0, 0], [0, 0, 1]).scale([38, 26, 1])
    glow = [strength * c for c in (15.0, 14.4, 13.4)]
    return {
        "sky": {"type": "envmap", "bitmap": bitmap, "to_world": frame},
        "window": {
            "type": "rectangle",
            "to_world": window,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": glow}},
        },
    }
