"""Whether cameras that came with a capture agree with what its photos show.

With given cameras key points are matched along the epipolar lines of those cameras alone, so that
what comes out agrees with them however wrong they are. Here some pairs of training photos are
matched by looks, and verified by a geometry of their own; right cameras explain these matches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.naming import listed_names
from mattgs_ops.sfm.colmap import mapping, matching
from mattgs_ops.sfm.colmap.features import Features, Pair
from mattgs_ops.sfm.colmap.job import Answer
from mattgs_ops.sfm.colmap.moving_object import FEWEST_MATCHES, explained
from mattgs_ops.sfm.colmap.steps import Attempt

# Each photo is compared with this many that look most like it: a wrong camera contradicts them all,
# so more would cost time alone
PARTNERS = 4
# Tested pairs below which nothing is said, as one may be a false match: of three views that match
# each other a wrong camera contradicts two pairs, and the third clears the other views
FEWEST_PAIRS = 3
MOST_NAMED = 8  # views in one warning, as among those without a camera


@dataclass(frozen=True)
class Told:
    """What photos say of given cameras: pairs, each explained or not, by the views' places."""

    pairs: Mapping[Pair, bool]

    def contradicted(self) -> list[int]:
        """Return the views that explain none of their pairs, sorted.

        A pair is laid to one view where it can be: those with the most unexplained pairs are taken
        first, and the pairs of a view that is taken count no longer.
        """
        left, out = dict(self.pairs), set[int]()
        while True:
            of_views: dict[int, list[bool]] = {}
            for pair, is_explained in left.items():
                for view in pair:
                    of_views.setdefault(view, []).append(is_explained)
            wrong = {view: len(told) for view, told in of_views.items() if not any(told)}
            if not wrong:
                return sorted(out)
            worst = {view for view, count in wrong.items() if count == max(wrong.values())}
            out |= worst
            left = {pair: told for pair, told in left.items() if not worst & set(pair)}

    def to_json(self, names: Sequence[str]) -> dict[str, Any]:
        """Return it as ``scene.json`` holds it; nothing is claimed of too few pairs."""
        enough = len(self.pairs) >= FEWEST_PAIRS
        return {
            "pairs": len(self.pairs),
            "explained": sum(self.pairs.values()),
            "contradicted": [names[view] for view in self.contradicted()] if enough else [],
        }


def ask_photos(
    state: Attempt,
    found: Sequence[Features],
    rows: Sequence[NDArray[np.int64]],
    cameras: Sequence[Any],
    model: Any,
) -> None:
    """Match views with those that look most like them; ``state.answer`` has what they say.

    ``rows`` are the key points of those ``found`` that a mode matches, ``cameras`` pycolmap's and
    ``model`` the views with their given poses. Pairs with fewer than 30 verified matches say
    nothing, as repeated parts have as many false ones; nor do those whose matches stay where they
    are, as a caption's do, and a room's behind a turntable. Of an object that has matches enough,
    these alone count: given cameras may be those of an object that turns.
    """
    job = state.job
    descriptors = [f.descriptors[r] for f, r in zip(found, rows, strict=True)]
    positions = [f.positions for f in found]
    sides = [max(view.width, view.height) for view in job.views]
    posed = mapping.posed(model)
    told: dict[Pair, bool] = {}
    with state.step("match"):
        verified = matching.match_and_verify(
            matching.most_similar(matching.similarities(descriptors, job.threads), PARTNERS),
            descriptors,
            rows,
            positions,
            [f.inside for f in found],
            cameras,
            state.config.seed,
            job.threads,
            lambda done, total, note: state.report("match", done, total, note),
        )
        for pair, one in verified.items():
            its = one.matches if one.on_object is None else one.on_object.matches
            still = matching.stand_still({pair: replace(one, matches=its)}, positions, sides)
            if len(its) >= FEWEST_MATCHES and not still:
                told[pair] = explained(pair, its, posed, mapping.rays_by(model, positions))
    state.answer.given_cameras = Told(told).to_json([view.name for view in job.views])


def in_doubt(answer: Answer) -> bool:
    """Say whether given cameras leave most pairs of photos unexplained: more than half."""
    told = answer.given_cameras
    pairs = told.get("pairs", 0)
    return bool(pairs >= FEWEST_PAIRS and 2 * told["explained"] < pairs)


def warnings(answer: Answer) -> list[str]:
    """Return what is wrong with given cameras, and what to do; empty where nothing is."""
    told = answer.given_cameras
    what = 'correct the cameras, or have poses estimated (sfm.poses = "estimate")'
    if in_doubt(answer):
        share = f"{told['explained']} of {told['pairs']} pairs of photos that match"
        return [f"given cameras contradict the photos: they explain only {share}; {what}"]
    if names := told.get("contradicted"):
        named = listed_names(names, MOST_NAMED)
        return [f"given cameras contradict all that other photos share with {named}; {what}"]
    return []
