"""The one self-contained page: everything inlined, nothing fetched.

Pictures travel as JPEG data URIs, splats as base64 of 16 bytes each, scripts and styles inline;
the page's own content security policy forbids any request.
"""

import base64
import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from reports.figures.pictures import Gallery, artifact
from reports.figures.plots import Saved
from reports.page import splat_view
from reports.rows.schema import background_name, capture_name, condition_name
from reports.tables import formats
from reports.tables.formats import Table
from reports.tables.side_tables import BUDGETS
from reports.tables.verdict import Verdict
from reports.templates import environment

TEMPLATES = Path(__file__).with_name("templates")
PICTURE_QUALITY = 82  # of JPEG; renders are judged by their scores, not by this copy
FIGURE_QUALITY = 88
PICTURE_WIDTH = 640  # pixels that a slider's picture has at most
FIGURE_WIDTH = 1600
OPEN_VERDICTS = 4  # captures whose numbers stand open under their verdicts
RUNS = "table-runs"  # long, and folded away
SLIDER_BUDGET = 16  # views per capture in the slider, evenly spaced
SCRIPTS = ("slider.js", "splats.js", "orbit.js", "report.js")
# What all captures of a page share, so that a large benchmark's page still opens on a phone: 12 MB
# each for sliders and 3D views, 20 MB for figures with photos, whatever the number of captures.
PICTURES, FEWEST_VIEWS = 600, 2  # pictures in sliders, and the views that a capture keeps anyhow
PIXELS = 44_000_000  # of all sliders' pictures: 0.27 bytes each as JPEG in base64, as measured
SPLATS = 600_000  # 21 bytes each
PHOTO_FIGURES = 20_000_000  # bytes in base64
BYTES_BY_WIDTH = 1.6  # the power by which a JPEG grows with its width, as measured


def render(
    *,
    title: str,
    summary: str,
    facts: Mapping[str, Any],
    verdicts: Sequence[Verdict],
    tables: Sequence[Table],
    figures: Sequence[Saved],
    first: Sequence[Saved] = (),
    captures: Sequence[Mapping[str, Any]] = (),
    problems: Sequence[str] = (),
    notes: Sequence[str] = (),
    warnings: Sequence[str] = (),
    missing: Sequence[str] = (),
) -> str:
    """Return the page's HTML.

    ``first`` are figures that stand before all else; ``captures`` what :func:`shown` returns;
    ``missing`` says which pictures are not shown.
    """
    templates = environment(TEMPLATES)
    templates.filters["unbroken"] = _unbroken
    inlined, share = _figures(figures)
    ahead, _ = _figures(first)
    return templates.get_template("report.html.j2").render(
        title=title,
        summary=summary,
        facts=facts,
        verdicts=verdicts,
        folded=sum(bool(verdict.capture) for verdict in verdicts) > OPEN_VERDICTS,
        tables=[formats.html(table) for table in tables if table.slug not in (RUNS, BUDGETS)],
        first=ahead,
        budgets=[formats.html(table) for table in tables if table.slug == BUDGETS],
        runs=[formats.html(table) for table in tables if table.slug == RUNS],
        figures=inlined,
        shrunk="" if share == 1 else f"{share * 100:.0f} %",
        captures=captures,
        problems=problems,
        notes=notes,
        warnings=warnings,
        missing=missing,
        data=_script_json({"captures": captures}),
        style=_text("report.css"),
        script="\n".join(_text(name) for name in SCRIPTS),
    )


def shown(galleries: Sequence[Gallery], root: Path | None) -> list[dict[str, Any]]:
    """Return what sliders and 3D views show, per capture that has something to show.

    ``root`` is the folder that rows' artifacts are relative to. What a 3D view lacks is added to
    what its gallery misses.
    """
    lanes = sum(len(gallery.conditions) + len(backgrounds(gallery)) for gallery in galleries)
    views = min(SLIDER_BUDGET, max(FEWEST_VIEWS, PICTURES // max(1, lanes)))
    models = sum(len(gallery.rows) for gallery in galleries)
    most = min(splat_view.MOST, SPLATS // max(1, models))
    pictures = sum(
        (len(gallery.conditions) + len(backgrounds(gallery))) * min(views, len(gallery.views))
        for gallery in galleries
    )
    pixels = PIXELS // max(1, pictures)
    captures = [_capture(gallery, root, views, pixels, most) for gallery in galleries]
    return [capture for capture in captures if capture["views"] or capture["models"]]


def _unbroken(text: str) -> Markup:
    """Keep a number, its unit and its sign on one line: 28 %, 0.5 dB, × 0.72; show code as code."""
    kept = re.sub(r"(?<=\d) (?=%|dB\b|px\b|seeds?\b)|(?<=×) (?=\d)", "\u00a0", text)
    return Markup(formats.prose(kept))


def _text(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _script_json(data: Any) -> str:
    """JSON that may stand inside a script element."""
    return json.dumps(data, separators=(",", ":"), sort_keys=True).replace("</", "<\\/")


def _figures(figures: Sequence[Saved]) -> tuple[list[dict[str, Any]], float]:
    """Inline all figures; those with photos shrink alike until they keep to their budget.

    Returns them and the share of their width that is left.
    """
    inlined, share = [_figure(figure, FIGURE_WIDTH) for figure in figures], 1.0
    while (taken := sum(len(one["uri"]) for one in inlined if one["pictorial"])) > PHOTO_FIGURES:
        share *= (PHOTO_FIGURES / taken) ** (1 / BYTES_BY_WIDTH)
        inlined = [
            _figure(figure, round(FIGURE_WIDTH * share)) if figure.pictorial else one
            for figure, one in zip(figures, inlined, strict=True)
        ]
    return inlined, share


def _figure(figure: Saved, widest: int) -> dict[str, Any]:
    """Inline one figure; one that would fill less than ``FIGURE_WIDTH`` stays as much smaller."""
    with Image.open(figure.png) as image:
        picture = image.convert("RGB")
        share = min(1.0, picture.width / FIGURE_WIDTH)
        across = round(share * widest)
        if picture.width > across:
            height = round(picture.height * across / picture.width)
            picture = picture.resize((across, height), Image.Resampling.LANCZOS)
        size = {"width": str(picture.width), "height": str(picture.height)}
        if figure.pictorial:
            uri = _jpeg(picture, FIGURE_QUALITY)
        else:
            buffer = io.BytesIO()
            picture.quantize(256, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
            uri = "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
    named = {"slug": figure.slug, "caption": figure.caption, "pictorial": figure.pictorial}
    return {**named, "uri": uri, "share": f"{share:.3f}", **size}


def _jpeg(picture: Image.Image, quality: int) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=quality, optimize=True, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def backgrounds(gallery: Gallery) -> list[str]:
    """Return the backgrounds of a capture's pictures, each once: each has a ground truth."""
    return list(dict.fromkeys(gallery.rows[name]["background"] for name in gallery.conditions))


def _capture(
    gallery: Gallery, root: Path | None, most_views: int, most_pixels: int, most_splats: int
) -> dict[str, Any]:
    """Collect what the slider and the 3D view of one capture need."""
    views = _evenly(gallery.views, most_views)
    lanes: dict[str, str] = {}
    for background in backgrounds(gallery):
        lanes[f"truth-{background}"] = f"{background_name(background)} · ground truth"
    for condition in gallery.conditions:
        row = gallery.rows[condition]
        lanes[condition] = condition_name(row["background"], row["method"])
    pictures: dict[str, dict[str, str]] = {}
    size = [4, 3]
    for view in views:
        slides: dict[str, str] = {}
        for condition in gallery.conditions:
            truth = f"truth-{gallery.rows[condition]['background']}"
            if truth not in slides:
                source = gallery.truths[gallery.rows[condition]["background"], view]
                slides[truth], size = _slide(source, most_pixels)
            slides[condition], size = _slide(gallery.renders[condition, view], most_pixels)
        pictures[view] = slides
    return {
        "id": gallery.capture,
        "name": capture_name(gallery.capture),
        "views": views,
        "all_views": len(gallery.views),
        "lanes": [{"id": key, "name": name} for key, name in lanes.items()],
        "start": _start(gallery),
        "first": next(
            (view for view in gallery.chosen() if view in views), views[0] if views else ""
        ),
        "pictures": pictures,
        "scores": _scores(gallery, views),
        "size": size,
        "models": _models(gallery, root, most_splats),
    }


def _slide(path: Path, most_pixels: int) -> tuple[str, list[int]]:
    with Image.open(path) as image:
        picture = image.convert("RGB")
    share = min(
        1.0,
        PICTURE_WIDTH / picture.width,
        math.sqrt(most_pixels / (picture.width * picture.height)),
    )
    if share < 1:
        width, height = (max(1, round(side * share)) for side in picture.size)
        picture = picture.resize((width, height), Image.Resampling.LANCZOS)
    return _jpeg(picture, PICTURE_QUALITY), [picture.width, picture.height]


def _start(gallery: Gallery) -> list[str]:
    """Return what the slider compares first: 3DGS and the last method, without background."""
    without = [c for c in gallery.conditions if gallery.rows[c]["background"] == "nobg"]
    conditions = without or gallery.conditions
    return [conditions[0], conditions[-1]] if conditions else []


def _scores(gallery: Gallery, views: Sequence[str]) -> dict[str, dict[str, str]]:
    """Scores shown beside the slider, by condition and view."""
    out: dict[str, dict[str, str]] = {}
    for condition in gallery.conditions:
        scored = {v["view"]: v for v in gallery.rows[condition]["per_view"] if v["split"] == "test"}
        for view in views:
            entry = scored.get(view, {})
            parts = [
                f"{label} {entry[key]:.2f} dB"
                for key, label in (("psnr", "PSNR"), ("mask_psnr", "in mask"))
                if isinstance(entry.get(key), int | float)
            ]
            out.setdefault(condition, {})[view] = ", ".join(parts)
    return out


def _models(gallery: Gallery, root: Path | None, most: int) -> list[dict[str, Any]]:
    models = []
    for condition, row in gallery.rows.items():
        train, scene = artifact(row, "train", root), artifact(row, "scene", root)
        if train is None or not (train / "splats.ply").is_file():
            gallery.missing.append((condition, "no splats for the 3D view"))
            continue
        if scene is None or not (scene / "scene.json").is_file():
            gallery.missing.append((condition, "no cameras for the 3D view"))
            continue
        name = condition_name(row["background"], row["method"])
        packed = splat_view.pack(train / "splats.ply", most)
        models.append({"id": condition, "name": name, **packed, **splat_view.orbit(scene)})
    return models


def _evenly(names: Sequence[str], most: int) -> list[str]:
    """Keep at most ``most`` of the names, evenly spaced, the first and last among them."""
    if len(names) <= most:
        return list(names)
    places = np.unique(np.linspace(0, len(names) - 1, most).round().astype(int))
    return [names[place] for place in places]
