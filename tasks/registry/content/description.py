"""A run's description in Markdown: what was trained on what, what came out, what is in doubt."""

import hashlib
from typing import Any

from mattgs_ops.score.metric_table import METRICS
from tasks.registry.content.about import About

NOTE_TAG = "mlflow.note.content"  # what the interface shows as a run's description
OWN_TAG = "mattgs.note"  # digest of the description that we wrote last
BACKGROUNDS = {"original": "with its background", "nobg": "with the background removed"}
SHOWN = ("mask_psnr", "mask_ssim", "psnr", "ssim", "size_mb", "splats", "time", "fps")
DIGEST_LETTERS = 12


def tags(row: dict[str, Any], about: About, old_tags: dict[str, str]) -> dict[str, str]:
    """Return the tags of the description; none where a person has changed what we wrote.

    ``old_tags`` are the run's tags so far.
    """
    if NOTE_TAG in old_tags and old_tags.get(OWN_TAG) != _digest(old_tags[NOTE_TAG]):
        return {}
    text = describe(row, about)
    return {NOTE_TAG: text, OWN_TAG: _digest(text)}


def describe(row: dict[str, Any], about: About) -> str:
    """Return the description of a row's run."""
    background = BACKGROUNDS.get(row["background"], row["background"])
    head = (
        f"3D Gaussian splats of **{row['capture']}** {background}, trained by **{row['method']}** "
        f"for {int(row['iterations']):,} steps at {row['resolution']} pixels, seed {row['seed']}"
        f"{_budget(row)}. "
        f"One experiment of the benchmark `{row['benchmark']}`."
    )
    parts = [
        head,
        *_state(row),
        *_scores(row),
        *(f"- **Warning:** {one['text']}" for one in row.get("warnings") or ()),
        *_origin(row, about),
    ]
    return "\n\n".join(parts)


def _budget(row: dict[str, Any]) -> str:
    return f", with at most {int(row['budget']):,} splats" if row.get("budget") else ""


def _state(row: dict[str, Any]) -> list[str]:
    if row["status"] == "failed":
        return [f"**Failed:** {row.get('reason') or 'no reason was given'}"]
    return ["Not finished yet."] if row["status"] == "running" else []


def _scores(row: dict[str, Any]) -> list[str]:
    """Return the scores of held-out views as a table."""
    found = row.get("metrics") or {}
    lines = [
        f"| {METRICS[name].label} | {found[name]:.{METRICS[name].decimals}f} {METRICS[name].unit} |"
        for name in SHOWN
        if name in METRICS and isinstance(found.get(name), int | float)
    ]
    return ["\n".join(["| held-out views | |", "|---|--:|", *lines])] if lines else []


def _origin(row: dict[str, Any], about: About) -> list[str]:
    provenance = row.get("provenance") or {}
    digest = str((provenance.get("inputs") or {}).get("capture") or "")[:DIGEST_LETTERS]
    photos = f"Photos: `{about.photos}`" if about.photos else ""
    lines = [f"{photos}, digest `{digest}`." if photos and digest else photos]
    if row["status"] == "finished":
        lines.append(
            "Files: `splats.ply` opens in any viewer of 3DGS, `renders/` are the held-out views, "
            "`per_view.json` their scores, `logs/` what the stages printed."
        )
    return [line for line in lines if line]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
