"""Ask the views for their votes in several ways, and keep what photos confirm.

Votes can be wrong in ways that photos show: the ground's cut leaves an even plate in shreds; maps
invent as much as they miss, so that a quarter of them is too little; haze, with which a short
training fills even ground and shade, hides a part of the object from one view. Each way of asking
ends in a decision (``decision``), and two are compared view by view, by how well the votes that
they end in meet the photo's own map and lie on the photo's edges (``surely_larger``).
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
from mattgs_ops.object_masks.objections import LEAST_LEFT
from mattgs_ops.object_masks.photo_evidence.significance import surely_larger
from mattgs_ops.object_masks.splats.ground_plane import Plane
from mattgs_ops.object_masks.splats.surfaces import without_haze
from mattgs_ops.object_masks.splats.votes import Ballot, collect, masks_of
from mattgs_ops.object_masks.witnesses import Known
from mattgs_ops.splat.gaussians import Splats

Worth = Callable[[ViewEvidence], float]


@dataclass(frozen=True)
class Judged:
    """A decision with the maps that follow, one a view, and how the votes were asked for."""

    decision: Decision
    maps: list[SoftMap]
    ground: Plane | None
    ground_cut: bool
    half_needed: bool
    haze_votes: bool = False

    @property
    def believed(self) -> bool:
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
        confirmed = self.decision.confirmed
        kept = "attached" if self.decision.attached_kept else "votes"
        return self.ground_cut and confirmed[kept] < confirmed["maps"]


@dataclass(frozen=True)
class Poll:
    """A poll of V views of which this is ``known``; those that are trained on vote and decide.

    ``voting`` and ``shown`` are the views' cameras at the sizes of votes and of maps; ``points``
    [P, 3] the triangulated ones.
    """

    known: Known
    voting: Sequence[Camera]
    shown: Sequence[Camera]
    points: NDArray[np.float64]
    threads: int

    def best(self, splats: Splats) -> Judged:
        """Let views vote on the splats without haze, and with it where that is surely better.

        Haze may also be what little a short training has put on an even, dark plate.
        """
        surfaces = without_haze(splats)
        clear = self._votes_on(surfaces)
        if len(surfaces) == len(splats):
            return clear
        hazy = self._votes_on(splats)
        return replace(hazy, haze_votes=True) if self._better(hazy, clear, _meets_both) else clear

    def _votes_on(self, splats: Splats) -> Judged:
        """Let views vote on these splats, by a quarter or a half, with the ground's cut or not."""
        ballot = collect(
            splats,
            self.voting,
            self.known.own.maps,
            self.points,
            trained=self.known.trained,
            threads=self.threads,
        )
        found = self._judged(ballot)
        if found.maps_invent:
            strict = self._judged(ballot, half_needed=True)
            passes = strict.believed and not found.believed
            found = strict if passes or self._better(strict, found, _meets_both) else found
        if found.cut_in_doubt or found.object_cut:
            without = self._judged(ballot, cut_ground=False, half_needed=found.half_needed)
            if without.believed:
                denied = found.object_cut or self._cut_is_denied(found, without)
                found = without if denied else found
            elif not found.believed:  # they only correct maps, by what is the better guess
                found = max(found, without, key=lambda one: self._mean(one, _meets_both))
        return found

    def _judged(
        self, ballot: Ballot | None, *, cut_ground: bool = True, half_needed: bool = False
    ) -> Judged:
        votes = ground = None
        if ballot is not None:
            ground = ballot.place.ground
            votes = masks_of(
                ballot,
                self.shown,
                cut_ground=cut_ground,
                half_needed=half_needed,
                threads=self.threads,
            )
        decision, maps = decide(self.known, votes)
        return Judged(decision, maps, ground, cut_ground and ground is not None, half_needed)

    def _cut_is_denied(self, cut: Judged, uncut: Judged) -> bool:
        """Whether votes without the ground's cut are surely better by edges, or by both witnesses.

        Maps alone do not tell: they take along a sheet that the object stands on.
        """
        if self._better(uncut, cut, _on_edges):
            return True
        no_less = self._mean(uncut, _on_edges) >= self._mean(cut, _on_edges)
        return no_less and self._better(uncut, cut, _meets)

    def _better(self, first: Judged, second: Judged, worth: Worth) -> bool:
        """Whether the first votes are surely worth more than the second ones, view by view."""
        return surely_larger(self._worths(first, worth), self._worths(second, worth))

    def _mean(self, judged: Judged, worth: Worth) -> float:
        return float(np.mean(self._worths(judged, worth)))

    def _worths(self, judged: Judged, worth: Worth) -> list[float]:
        return [worth(judged.decision.views[index]) for index in self.known.deciding]


def _on_edges(view: ViewEvidence) -> float:
    return view.confirmed or 0.0


def _meets(view: ViewEvidence) -> float:
    return view.with_parts or 0.0


def _meets_both(view: ViewEvidence) -> float:
    """Return how well votes meet the photo's map and its edges together."""
    return _meets(view) * _on_edges(view)
