"""Cut the object out of every photo of a capture: ``segment(capture, config, out)``.

Writes ``out/masks/NAME.png`` (8-bit, 255 = object), ``out/soft/NAME.png`` (8-bit, the map before
its threshold) and ``out/masks.json`` (:class:`MaskReport`). Of a model file of several networks the
map is their mean, and ``out/soft/1/NAME.png``, … is what each of them says.

``source``: ``auto`` uses masks that came with the capture (alpha, or the user's own), else U²-Net;
``given`` insists on masks that came with it, a renderer's exact ones included; ``grabcut`` works
without a network; ``none`` makes everything the object.
"""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.mask_files import decode_mask, looks_inverted, polarity_problem
from mattgs_ops.capture.masks import (
    Mask,
    SoftMap,
    clean,
    mask_name,
    quality,
    threshold,
)
from mattgs_ops.capture.photos import read_rgb, write_png
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import SegmentConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.grabcut import grabcut, grabcut_seeded
from mattgs_ops.segment.mask_report import MaskReport, ViewReport, border_share, flags_of
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork


def segment(
    capture: PreparedCapture,
    config: SegmentConfig,
    out: Path,
    *,
    threads: int = 1,
    progress: Progress = no_progress,
) -> MaskReport:
    """Write a mask for every view; see the module's docstring.

    A photo in which nothing was found gets a black mask and the flag ``empty``: its view is dropped
    later, unless other views lend it a mask. Raises :class:`InputError` for a bad model or bad
    given masks, and :class:`StageError` where nothing was found in any photo.
    """
    source = resolve_source(capture, config)
    network = None
    if source == "u2net":
        network = SaliencyNetwork(config.model or BUNDLED_MODEL, threads=threads)
    if source == "given":
        check_given(capture.views)
    for folder in ("masks", "soft"):
        shutil.rmtree(out / folder, ignore_errors=True)
        (out / folder).mkdir(parents=True)
    cv2.setNumThreads(threads)
    rows: list[tuple[float, float, ViewReport]] = []

    def keep(view: View, maps: Sequence[SoftMap], mask: Mask) -> None:
        write_png(out / "masks" / mask_name(view.name), mask)
        for index, soft in enumerate(maps):
            folder = out / "soft" / (str(index) if index else "")
            folder.mkdir(exist_ok=True)
            write_png(folder / mask_name(view.name), np.rint(soft * 255).astype(np.uint8))
        rows.append((border_share(mask), *_scored(view, mask, maps[0], capture)))
        progress(len(rows), len(capture.views), f"masks by {source}")

    if network is not None:
        for view, photo, maps in _network_maps(capture, network):
            keep(view, maps, _binary(photo, maps[0], config))
    else:
        for view in capture.views:
            mask = _without_network(view, source)
            keep(view, [(mask / np.float32(255)).astype(np.float32)], mask)
    if not any(row[1] for row in rows):
        raise StageError(
            f"{capture.name}: no object was found in any of {len(rows)} photos; give masks of your "
            "own (--masks), or another network (segment.model)"
        )
    flags = flags_of([row[1] for row in rows], [row[0] for row in rows])
    reports = (
        ViewReport(row[2].name, row[1], () if source == "none" else flag, row[2].quality)
        for row, flag in zip(rows, flags, strict=True)
    )
    # views vote later, in a stage of its own, when their cameras are known
    refine = "grabcut" if source == "u2net" and config.refine == "grabcut" else "none"
    report = MaskReport(source, refine, network.digest if network else None, tuple(reports))
    report.save(out / "masks.json")
    return report


def resolve_source(capture: PreparedCapture, config: SegmentConfig) -> str:
    """Return ``u2net``, ``grabcut``, ``given`` or ``none``; raises :class:`InputError`."""
    if config.source == "auto":
        return "given" if capture.masks_are in ("alpha", "given") else "u2net"
    if config.source == "given" and capture.masks_are == "none":
        raise InputError(
            f"{capture.name}: `segment.source` is `given`: expected masks that came with the "
            "capture (alpha, or a folder of masks), found none"
        )
    return config.source


def check_given(views: Sequence[View]) -> None:
    """Read all given masks once, before anything is written.

    Raises :class:`InputError` naming file, expected and found: a missing or broken mask, another
    size, wholly white or black, or black and white exchanged.
    """
    inverted = {}
    for view in views:
        mask = given_mask(view)
        inverted[view.name] = looks_inverted(mask)
        if mask.all():
            raise InputError(
                f"{view.mask}: expected object and background, found a mask that is white all over"
            )
    problem = polarity_problem(inverted)
    if problem:
        raise InputError(problem)


def given_mask(view: View) -> Mask:
    """Read the mask that came with a view."""
    if view.mask is None:
        raise InputError(f"{view.name}: expected a mask that came with the photo, found none")
    return decode_mask(view.mask, (view.width, view.height))


def _network_maps(
    capture: PreparedCapture, network: SaliencyNetwork
) -> Iterator[tuple[View, NDArray[np.uint8], list[SoftMap]]]:
    for start in range(0, len(capture.views), network.batch):
        views = capture.views[start : start + network.batch]
        photos = [read_rgb(view.photo) for view in views]
        maps = network.all_maps(photos, [view.name for view in views])
        yield from zip(views, photos, maps, strict=True)


def _binary(photo: NDArray[np.uint8], soft: SoftMap, config: SegmentConfig) -> Mask:
    refined = config.refine == "grabcut"
    return clean(grabcut_seeded(photo, soft) if refined else threshold(soft, config.threshold))


def _without_network(view: View, source: str) -> Mask:
    if source == "given":
        return given_mask(view)
    if source == "none":
        return np.full((view.height, view.width), 255, np.uint8)
    return clean(grabcut(read_rgb(view.photo)))


def _scored(
    view: View, mask: Mask, soft: SoftMap, capture: PreparedCapture
) -> tuple[float, ViewReport]:
    share = float((mask > 0).mean())
    if capture.masks_are != "truth" or view.mask is None:
        return share, ViewReport(view.name, share, (), None)
    truth = given_mask(view)
    return share, ViewReport(view.name, share, (), quality(mask, truth, soft))
