"""What the worker process is told and what it answers, as JSON beside its files.

The job names files and parameters; the answer holds counts, seconds and the fallbacks taken. The
model itself comes back as COLMAP's binary files in ``<workspace>/model``.
"""

import json
import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mattgs_ops.capture.formats.exif import FILM_DIAGONAL
from mattgs_ops.config import SfmConfig

JOB_FILE, ANSWER_FILE, MODEL_FOLDER = "job.json", "answer.json", "model"
KEYPOINTS_FILE = "keypoints.npz"
DATABASE_FILE = "database.db"


@dataclass(frozen=True)
class JobView:
    """One photo with its mask; ``pose`` is (R row by row, t), world-to-camera, where known.

    ``focal`` is the focal length in pixels that the photo's EXIF tells: where estimation starts.
    ``lens`` is what EXIF says of the camera. ``taken``: width and height before the photo was
    reduced, None where it was not.
    A ``held_out`` photo gets a pose with all others, and shapes no point.
    """

    name: str
    photo: str
    mask: str
    width: int
    height: int
    intrinsics: tuple[float, float, float, float] | None  # fx, fy, cx, cy of a known pinhole
    pose: tuple[float, ...] | None  # 12 numbers
    focal: float | None = None
    lens: str = ""
    held_out: bool = False
    taken: tuple[int, int] | None = None

    @property
    def as_taken(self) -> tuple[int, int]:
        """Width and height before the photo was reduced."""
        return self.taken or (self.width, self.height)

    @property
    def reduced(self) -> float:
        """Pixels per pixel of the photo as it was taken."""
        return max(self.width, self.height) / max(self.as_taken)


@dataclass(frozen=True)
class Job:
    """Everything the worker needs; ``config`` is a dumped :class:`SfmConfig`."""

    workspace: str
    views: tuple[JobView, ...]
    config: dict[str, Any]
    threads: int

    @property
    def sfm(self) -> SfmConfig:
        """The validated configuration."""
        return SfmConfig.model_validate(self.config)

    @property
    def poses_known(self) -> bool:
        """Whether every view comes with its pose."""
        return all(view.pose is not None for view in self.views)

    @property
    def exif_focal(self) -> str:
        """The focal lengths by EXIF that estimation starts from, in words; empty where from none.

        They are 35 mm equivalents, as cameras and programs show them: ``28 to 70 mm``, say.
        """
        told = {
            round(view.focal * FILM_DIAGONAL / math.hypot(view.width, view.height))
            for view in self.views
            if view.focal is not None and view.intrinsics is None
        }
        if not told:
            return ""
        numbers = " to ".join(str(one) for one in sorted({min(told), max(told)}))
        return f"EXIF's focal length ({numbers} mm, 35 mm equivalent)"

    def without_exif_focal(self) -> "Job":
        """Return the job without the focal lengths that EXIF tells."""
        return replace(self, views=tuple(replace(view, focal=None) for view in self.views))

    def save(self) -> Path:
        """Write the job into its workspace and return the file."""
        path = Path(self.workspace) / JOB_FILE
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")
        return path

    @classmethod
    def load(cls, path: Path) -> "Job":
        """Read a job."""
        data = json.loads(path.read_text(encoding="utf-8"))
        views = []
        for row in data.pop("views"):
            for key in ("intrinsics", "pose", "taken"):
                row[key] = None if row[key] is None else tuple(row[key])
            views.append(JobView(**row))
        return cls(views=tuple(views), **data)


@dataclass
class Answer:
    """What happened, counted. ``keypoints`` found go by view: (all, inside the mask)."""

    mode: str
    keypoints: dict[str, tuple[int, int]] = field(default_factory=dict)
    used: dict[str, int] = field(default_factory=dict)  # whole, masked: after the cap
    pairs: dict[str, int] = field(default_factory=dict)  # by set of key points: pairs tried
    matches: dict[str, int] = field(default_factory=dict)  # by set: matches that were kept
    fallbacks: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)  # by step, on the wall
    cpu_seconds: dict[str, float] = field(default_factory=dict)  # by step, of this process
    registered: list[str] = field(default_factory=list)
    components: list[list[str]] = field(default_factory=list)  # views by model, largest first
    # by view: photos that match it after verification with their inliers, best first
    partners: dict[str, list[tuple[str, int]]] = field(default_factory=dict)
    # of the pairs that show the object, the shares of those that contradict their whole photos and
    # of those that the poses of each mode explain (moving_object); None where no pair shows it
    object_motion: dict[str, float | None] = field(default_factory=dict)
    # by look_alikes: pairs that share most beside the object, and how many of them the poses of
    # whole photos explain
    beside_object: dict[str, int] = field(default_factory=dict)
    cropped: list[str] = field(default_factory=list)  # views whose lens's axis was moved (lenses)
    on_side: str = ""  # which views lie on their side before the others (rolled_groups), in words
    # pairs of photos that were matched by looks, how many of them given cameras explain, and the
    # views that contradict all of theirs (given_poses); empty where cameras were estimated
    given_cameras: dict[str, Any] = field(default_factory=dict)
    models: int = 0
    points: int = 0
    mapped_points: int = 0  # before points were triangulated again with poses held fixed
    reprojection_error: float | None = None
    threads: int = 1

    def tell(self, fallback: str) -> None:
        """Add a fallback, once however many attempts take it."""
        if fallback not in self.fallbacks:
            self.fallbacks.append(fallback)

    def save(self, workspace: Path) -> None:
        """Write the answer into the workspace."""
        text = json.dumps(asdict(self), indent=1)
        (workspace / ANSWER_FILE).write_text(text, encoding="utf-8")

    @classmethod
    def load(cls, workspace: Path) -> "Answer":
        """Read the answer."""
        data = json.loads((workspace / ANSWER_FILE).read_text(encoding="utf-8"))
        data["keypoints"] = {k: tuple(v) for k, v in data["keypoints"].items()}
        data["partners"] = {k: [(n, c) for n, c in v] for k, v in data["partners"].items()}
        return cls(**data)
