"""Let the views vote in several ways, and keep the variant that fits the photos best.

Votes can be wrong in ways that photos show: the ground's cut leaves an even plate in shreds; maps
invent as much as they miss, so that a quarter of them is too little; haze, with which a short
training fills even ground and shade, hides a part of the object from one view. Each variant ends
in a decision (``decision``), and two are compared view by view, by how well the votes that they
end in overlap the photo's own map and lie on the photo's edges (``surely_larger``).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.decision import (
    Decision,
    ViewEvidence,
    decide,
    half_meet_best,
)
from mattgs_ops.object_masks.map_scores import ViewMaps
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.splats.ground_plane import Plane
from mattgs_ops.object_masks.splats.surfaces import without_haze
from mattgs_ops.object_masks.splats.votes import SplatVotes, VotedMaps, collect, masks_of
from mattgs_ops.object_masks.vote_checks import LEAST_LEFT
from mattgs_ops.splat.gaussians import Splats

Measure = Callable[[ViewEvidence], float]


@dataclass(frozen=True)
class Outcome:
    """A decision with the maps that follow, one a view, the votes and their variant."""

    decision: Decision
    maps: list[SoftMap]
    votes: VotedMaps | None
    ground: Plane | None
    ground_cut: bool
    half_needed: bool
    haze_votes: bool = False

    @property
    def votes_used(self) -> bool:
        """Whether votes make the masks."""
        return self.decision.masks == "votes"

    @property
    def maps_invent(self) -> bool:
        """Whether maps may invent as much as they miss (``decision.half_meet_best``)."""
        level = self.decision.level
        return level is not None and half_meet_best(level)

    @property
    def object_cut(self) -> bool:
        """Whether the cut leaves too little of what the maps show, as of a facade."""
        left = self.decision.left
        return self.ground_cut and left is not None and left < LEAST_LEFT

    @property
    def cut_in_doubt(self) -> bool:
        """Whether outlines that the cut leaves lie beside the photos' edges more than the maps' do.

        An even plate under the object is as low as the ground, and splats lie at any height in it.
        """
        on_edges = self.decision.confirmed
        kept = "attached" if self.decision.attached_kept else "votes"
        return self.ground_cut and on_edges[kept] < on_edges["maps"]


@dataclass(frozen=True)
class VoteVariants:
    """The variants of the vote of V ``views``, of which those that are trained on vote and decide.

    ``voting`` and ``shown`` are the views' cameras at the sizes of votes and of maps; ``points``
    [P, 3] the triangulated ones.
    """

    views: ViewMaps
    voting: Sequence[Camera]
    shown: Sequence[Camera]
    points: NDArray[np.float64]
    threads: int

    def best(self, splats: Splats) -> Outcome:
        """Let views vote on the splats without haze, and with it where those votes are preferred.

        Haze may also be what little a short training has put on an even, dark plate. The best
        votes are compared with the maps once more; not where ground was cut away, which all maps
        may take along.
        """
        surfaces = without_haze(splats)
        found = self._votes_on(surfaces)
        if len(surfaces) < len(splats):
            hazy = replace(self._votes_on(splats), haze_votes=True)
            found = self._preferred(hazy, found)
        if not found.votes_used or found.ground_cut:
            return found
        decision, maps = decide(self.views, found.votes, final=True)
        return replace(found, decision=decision, maps=maps)

    def _votes_on(self, splats: Splats) -> Outcome:
        """Let views vote on these splats, by a quarter or a half, with the ground's cut or not."""
        splat_votes = collect(
            splats,
            self.voting,
            self.views.own.maps,
            self.points,
            trained=self.views.trained,
            threads=self.threads,
        )
        found = self._outcome(splat_votes)
        if found.maps_invent:
            strict = self._outcome(splat_votes, half_needed=True)
            found = self._preferred(strict, found)
        if found.cut_in_doubt or found.object_cut:
            without = self._outcome(splat_votes, cut_ground=False, half_needed=found.half_needed)
            if without.votes_used:
                better = found.object_cut or self._surely_better_uncut(found, without)
                found = without if better else found
            elif not found.votes_used:  # they only correct maps, by what is the better guess
                found = max(found, without, key=lambda one: self._mean(one, _worth))
        return found

    def _preferred(self, other: Outcome, usual: Outcome) -> Outcome:
        """Return the other outcome where its votes alone are used, or are surely worth more."""
        passes = other.votes_used and not usual.votes_used
        return other if passes or self._better(other, usual, _worth) else usual

    def _outcome(
        self, splat_votes: SplatVotes | None, *, cut_ground: bool = True, half_needed: bool = False
    ) -> Outcome:
        votes = ground = None
        if splat_votes is not None:
            ground = splat_votes.place.ground
            votes = masks_of(
                splat_votes,
                self.shown,
                cut_ground=cut_ground,
                half_needed=half_needed,
                threads=self.threads,
            )
        decision, maps = decide(self.views, votes)
        return Outcome(
            decision, maps, votes, ground, cut_ground and ground is not None, half_needed
        )

    def _surely_better_uncut(self, cut: Outcome, uncut: Outcome) -> bool:
        """Whether votes without the ground's cut are surely better by edges, or by both measures.

        Maps alone do not tell: they take along a sheet that the object stands on.
        """
        if self._better(uncut, cut, _on_edges):
            return True
        no_less = self._mean(uncut, _on_edges) >= self._mean(cut, _on_edges)
        return no_less and self._better(uncut, cut, _overlap)

    def _better(self, first: Outcome, second: Outcome, measure: Measure) -> bool:
        """Whether the first votes surely measure more than the second ones, view by view."""
        return surely_larger(self._measured(first, measure), self._measured(second, measure))

    def _mean(self, outcome: Outcome, measure: Measure) -> float:
        return float(np.mean(self._measured(outcome, measure)))

    def _measured(self, outcome: Outcome, measure: Measure) -> list[float]:
        return [measure(outcome.decision.views[index]) for index in self.views.trained_views]


def _on_edges(view: ViewEvidence) -> float:
    return view.confirmed or 0.0


def _overlap(view: ViewEvidence) -> float:
    return view.with_parts or 0.0


def _worth(view: ViewEvidence) -> float:
    """Return what votes are worth in a view: overlap with its map times share on its edges."""
    return _overlap(view) * _on_edges(view)
