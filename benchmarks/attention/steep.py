"""Attention on against off where no ids say what is small: on the steepest pixels of the object.

    python benchmarks/attention/steep.py OUT/benchmarks/attention-others/rows.json --store OUT/store

Of each held-out view the tenth of the object's pixels, without its outline, at which the truth has
the largest Sobel magnitude counts: edges, print, the ends of thin things. Prints a Markdown table
of `attention` − `mask`, paired by view and seed, for these pixels and for all of the object, and
over captures, which are the sample there.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from mattgs_ops.splat.attention import Floats, inner, sobel_magnitude
from reports.rows import statistics
from reports.rows.statistics import Interval

ON, OFF = "attention", "mask"  # methods of the benchmark
SHARE = 0.1  # of the object's pixels; part ids mark 3 to 18 % of the project's own captures
LEAST_ERROR = 1e-10  # mean squared: 100 dB


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--store", type=Path, required=True, help="where the rows' renders lie")
    given = parser.parse_args()
    rows = [row for path in given.rows for row in json.loads(path.read_text(encoding="utf-8"))]
    scored: dict[tuple[str, int], dict[str, dict[tuple[str, int], tuple[float, float]]]] = {}
    for row in rows:
        if row["status"] == "finished":
            method = row["condition"].partition("-")[2]
            folder = given.store / row["artifacts"]["evaluate"]
            cell = scored.setdefault((row["capture"], row["budget"]), {}).setdefault(method, {})
            cell |= {(view, row["seed"]): found for view, found in view_scores(folder).items()}
    print("| capture | splats | held-out views | steepest tenth | off | all of the object |")
    print("|---|---|---|---|---|---|")
    means: dict[int, list[float]] = {}
    for (capture, budget), methods in sorted(scored.items()):
        if not {ON, OFF} <= set(methods):
            continue
        on, off = methods[ON], methods[OFF]
        gaps = [
            statistics.paired(
                {key: scores[k] for key, scores in on.items()},
                {key: scores[k] for key, scores in off.items()},
            )
            for k in range(2)
        ]
        if gaps[0] is not None:
            means.setdefault(budget, []).append(gaps[0].mean)
        level = float(np.mean([scores[0] for scores in off.values()]))
        cells = [shown(gaps[0]), f"{level:.2f} dB", shown(gaps[1])]
        views = len({view for view, _ in on})
        print(f"| {capture} | {budget:,} | {views} | {' | '.join(cells)} |")
    for budget, found in sorted(means.items()):
        over_captures = statistics.sample(found) if len(found) > 1 else None
        print(f"| mean of captures | {budget:,} | | {shown(over_captures)} | | |")


def view_scores(folder: Path) -> dict[str, tuple[float, float]]:
    """Return PSNR in dB on the steepest pixels and on all of the object, by test view."""
    return {
        path.name: psnrs(
            read(folder / "renders" / "test" / path.name),
            read(path),
            read(folder / "masks" / "test" / path.name)[:, :, 0],
        )
        for path in sorted((folder / "truth" / "test").glob("*.png"))
    }


def psnrs(image: Floats, truth: Floats, mask: Floats) -> tuple[float, float]:
    """Return PSNR in dB of the steepest pixels and of the mask's; images [H, W, 3] in [0, 1]."""
    thing = inner(mask)
    magnitude = sobel_magnitude(truth)
    steep = thing & (magnitude >= np.quantile(magnitude[thing], 1 - SHARE))
    errors = np.square(image - truth).mean(axis=2)
    return psnr(errors[steep]), psnr(errors[mask >= 0.5])


def psnr(errors: Floats) -> float:
    """Return PSNR in dB of squared errors."""
    return -10 * float(np.log10(max(float(errors.mean()), LEAST_ERROR)))


def read(path: Path) -> Floats:
    """Read an image [H, W, 3] in [0, 1]."""
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR), dtype=np.float32)
    return pixels / np.float32(255)


def shown(gap: Interval | None) -> str:
    """Print a mean with half of its interval, bold where the sign is beyond doubt."""
    if gap is None:
        return "-"
    text = f"{gap.mean:+.2f} ± {gap.half:.2f} dB".replace("-", "−")
    return f"**{text}**" if gap.excludes_zero() else text


if __name__ == "__main__":
    main()
