"""``mattgs check``: a look at photos and masks before the long run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from flows.cli.terminal import bar, duration
from flows.grid import cells
from mattgs_ops.capture import visual_hull
from mattgs_ops.capture.masks import mask_name, read_map
from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import BenchmarkConfig, CaptureConfig, SfmConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.naming import listed_names
from mattgs_ops.progress import Progress
from mattgs_ops.segment.contradictions import LEAST_SHARED, contradictions
from mattgs_ops.segment.infer import segment
from mattgs_ops.segment.inspect_photos import AT_SMALL_ANGLES, MOST_LISTED, Inspected, inspect
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.segment.matches_by_cameras import LEAST_EXPLAINED, share_explained
from mattgs_ops.segment.quick_matches import shrunk_mask
from mattgs_ops.sfm.checks import check_given_cameras, keeps_poses
from mattgs_ops.sfm.lost_views import MOST_VIEWS
from mattgs_ops.sfm.world_units import check_units
from reports.figures.mask_sheets import draw
from reports.figures.plots import style
from tasks.stages.cores import own_cores

# Seconds of a run at its default settings on two cores of 2026, by what they grow with. The first
# two are fitted to structure-from-motion of 43 real captures of 7 to 180 photos, 38 of which took
# half to twice as long; the others are of `make run` (216 photos of 0.48 megapixels, 18
# trainings), those of trainings summed over workers.
A_MEGAPIXEL = 0.3  # structure-from-motion: key points
A_VIEW = 0.34  # matches and poses
A_PHOTO = 0.65  # segmentation and agreement between views
A_STEP = 0.02  # of a training at 320 pixels
A_TRAINING = 10.5  # scores and speed
WORKERS = 2
# By PreparedCapture.masks_are; nothing where the network segments
WHOSE_MASKS = {"given": "; masks came with them", "alpha": "; their alpha is the mask"}
# All attempts at structure-from-motion took 2.9 to 9.6 times what the first is said to take, by
# seven real captures of 16 to 135 photos
ALL_ATTEMPTS = 10
# By lenses of up to 53 degrees the masks' hull reaches half of the way from the object to the
# cameras (`visual_hull.shared_cube`)
BEFORE_OBJECT = 2.0


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a run takes for one capture, in seconds, to within a factor of two.

    ``further_attempts`` come on top where structure-from-motion places too few photos at first.
    """

    seconds: float
    further_attempts: float
    likely_again: bool


def check(config: BenchmarkConfig, out: Path) -> bool:
    """Check the captures of ``config``; return whether a run has something to work with in each.

    Prints what is wrong and writes ``out/CAPTURE/masks.png``. Raises :class:`InputError` for photos
    that cannot be used, naming all of them, once all captures were looked at.
    """
    console = Console(soft_wrap=True)
    problems: list[str] = []
    estimates: list[Estimate | None] = []
    for capture in config.captures:
        try:
            lines, found = _look(capture, config, out / capture.name)
        except InputError as error:
            problems.append(str(error))
            continue
        estimates.append(found)
        if len(config.captures) > 1:
            lines = [f"{capture.name}:", *(f"  {line}" for line in lines)]
        for line in lines:
            console.print(line, markup=False, highlight=False)
    if problems:
        raise InputError("\n".join(problems))
    usable = [e for e in estimates if e is not None]
    if len(usable) < len(estimates):
        return False
    console.print(_time_of_a_run(usable), highlight=False)
    return True


def _time_of_a_run(estimates: Sequence[Estimate]) -> str:
    told = f"a full run takes about {duration(sum(e.seconds for e in estimates))} on two cores"
    attempts = sum(e.further_attempts for e in estimates)
    if not attempts:
        return told
    longest = duration(sum(e.seconds for e in estimates) + attempts)
    when = "as" if any(e.likely_again for e in estimates) else "where"
    return f"{told}; {when} photos without a camera are sought anew, up to {longest}"


def _look(
    capture: CaptureConfig, config: BenchmarkConfig, out: Path
) -> tuple[list[str], Estimate | None]:
    """Return what is to be said of a capture, and what a run takes.

    None instead of an estimate: there is nothing to work with.
    """
    with bar(f"check {capture.name}") as progress:
        every, threads = config.test_every, own_cores()
        prepared = prepare(
            capture, out / "prepared", test_every=every, threads=threads, progress=progress
        )
        given = keeps_poses(prepared, config.sfm)
        if given:
            _check_cameras(prepared, config.sfm.min_registered)
        seen = inspect(prepared, estimate=not given, progress=progress)
        try:
            report = segment(
                prepared, config.segment, out / "segmented", threads=threads, progress=progress
            )
        except StageError as error:
            raise InputError(str(error)) from error
        masks = out / "segmented" / "masks"
        views = [replace(view, mask=masks / mask_name(view.name)) for view in prepared.views]
        about_cameras = []
        if given and prepared.points is None:
            about_cameras = _about_cameras(prepared, views, config.sfm, progress)
    good = seen.placed >= config.sfm.min_registered * len(seen.names)
    sheet = _sheet(views, report, out)
    about = [*about_cameras, *_about_masks(seen, report, views)]
    lines = [*_lines(prepared, seen, about, good=good), f"masks: {sheet}"]
    return lines, estimate(prepared, config, seen.placed, given=given) if good else None


def _check_cameras(capture: PreparedCapture, least: float) -> None:
    """Raise :class:`InputError` where a run would refuse the cameras that came along."""
    check_given_cameras(capture, least)
    if capture.points is not None:
        trained = [v.camera for v in capture.views if v.split == "train" and v.camera is not None]
        check_units(capture.name, trained, capture.points.xyz)


def _about_cameras(
    capture: PreparedCapture, views: Sequence[View], config: SfmConfig, progress: Progress
) -> list[str]:
    """Say whether cameras that came along without points show one object, and in usable units.

    Raises :class:`InputError` with a run's own words where a run would surely fail. It triangulates
    points, which only matches can tell of, and takes some of the hull where there are few.
    """
    try:
        hull = visual_hull.fill(views, config.random_points, config.seed)
    except StageError as error:
        matches = inspect(capture, estimate=True, progress=progress).matches
        explained = share_explained(matches, views)
        if explained is not None and explained < LEAST_EXPLAINED:
            raise InputError(f"{capture.name}: {error}") from error
        return [f"! unless a run triangulates points enough on the object, it fails: {error}"]
    cameras = [v.camera for v in views if v.split == "train" and v.camera is not None]
    try:
        check_units(capture.name, cameras, hull.xyz)
    except InputError as error:
        farther = [replace(c, translation=BEFORE_OBJECT * c.translation) for c in cameras]
        try:
            check_units(capture.name, farther, BEFORE_OBJECT * hull.xyz)
        except InputError:
            raise error from None
        return [f"! a run may refuse this, by the points that it finds: {error}"]
    return []


def _about_masks(seen: Inspected, report: MaskReport, views: Sequence[View]) -> list[str]:
    """Say which masks look wrong, each by itself or beside those of photos that show the same."""
    lines = []
    flags = [f"{view.name} ({', '.join(view.flags)})" for view in report.flagged]
    if flags:
        lines.append(f"! masks that look wrong: {listed_names(flags, MOST_LISTED)}")
    small = [shrunk_mask(read_map(view.mask)) for view in views if view.mask]
    places = {pair: matches.places for pair, matches in seen.matches.items()}
    found = contradictions(places, small)
    if found.views:
        names = listed_names([seen.names[index] for index in found.views], MOST_LISTED)
        lines.append(f"! masks that contradict other photos' at points that both show: {names}")
    if found.shared is not None and found.shared < LEAST_SHARED:
        lines.append(
            f"! of the points that two photos show and one mask holds, both masks hold only "
            f"{found.shared:.0%}: look at the masks, or bring your own (--masks)"
        )
    return lines


def _lines(
    capture: PreparedCapture, seen: Inspected, about: Sequence[str], *, good: bool
) -> list[str]:
    sizes = sorted({f"{view.width}x{view.height}" for view in capture.views})
    masks = WHOSE_MASKS.get(capture.masks_are, "")
    lines = [f"{len(seen.names)} photos, {', '.join(sizes)} pixels as they are used{masks}"]
    lines += [*(f"! {problem}" for problem in seen.problems), *about]
    count = f"{seen.placed} of {len(seen.names)} photos"
    if good:
        return [*lines, f"about {count} will get a camera"]
    remedy = "take photos closer to each other, with the background in place"
    if seen.stands_still:
        remedy = AT_SMALL_ANGLES
    return [*lines, f"✗ {count} hang together: too few for a run; {remedy}"]


def estimate(
    capture: PreparedCapture, config: BenchmarkConfig, placed: int, *, given: bool
) -> Estimate:
    """Estimate what a run takes where ``placed`` photos hang together or cameras are ``given``."""
    count = len(capture.views)
    megapixels = sum(view.width * view.height for view in capture.views) / 1e6
    trainings = len(list(cells(config, capture.name)))
    area = (config.resolution / BenchmarkConfig().resolution) ** 2
    trained = trainings * (config.iterations * A_STEP * area + A_TRAINING)
    sfm = A_MEGAPIXEL * megapixels + A_VIEW * count
    return Estimate(
        seconds=sfm + A_PHOTO * count + trained / WORKERS,
        further_attempts=0.0 if given else (ALL_ATTEMPTS - 1) * sfm,
        likely_again=not given and placed < MOST_VIEWS * count,
    )


def _sheet(views: Sequence[View], report: MaskReport, out: Path) -> Path:
    """Draw the photos with their masks' outlines."""
    flags = {view.name: view.flags for view in report.views}
    with style():
        saved = draw(views, flags, out, "masks", "", all_registered=True, vector=False)
    return saved.png
