"""Why votes do not make the masks: of the capture, or of a single view.

``objection`` says it for the capture, in words that go into ``scene.json``: votes meet maps and
edges less than silhouettes and maps do, the ground's cut went through the object, both witnesses
surely prefer the maps, or the ground is plain and edges leave nothing to mend. ``denied_views``
says which views' own evidence is against their votes.
"""

from collections.abc import Sequence

import numpy as np

from mattgs_ops.capture.masks import HALF, SoftMap
from mattgs_ops.object_masks.photo_evidence.colours import GOOD
from mattgs_ops.object_masks.photo_evidence.significance import lowest_expected, surely_larger
from mattgs_ops.object_masks.silhouettes import CONTRADICT, overlaps
from mattgs_ops.object_masks.splats.votes import Votes
from mattgs_ops.object_masks.witnesses import UNCONFIRMED, Known, Witnessed

LEAST = 0.01  # agreement below it counts as this much: ratios stay finite
# Of what the maps show: a ground's cut that leaves less went through the object, as through a
# facade on which most points lie. Maps may take along what the object stands on, but hardly three
# times its own size of that.
LEAST_LEFT = 0.25


def objection(
    known: Known,
    votes: Votes,
    voted: Witnessed,
    agreement: float,
    confirmed: dict[str, float],
    left: float,
) -> str:
    """Say why votes do not make the capture's masks; empty where they do.

    ``voted`` are the masks that the votes would make, ``agreement`` is their IoU with the own maps,
    ``confirmed`` the share of outlines on edges by whose they are, ``left`` see ``share_left``.
    """
    by_agreement = _objection_of_agreement(known.silhouettes, agreement, confirmed)
    if by_agreement:
        return by_agreement
    if votes.place.ground is not None and left < LEAST_LEFT:
        return f"the ground's cut leaves {left:.2f} of what the photos' maps show"
    if denied_by_both(known, voted):
        return "the photos' edges and the other views' silhouettes surely prefer the maps"
    if known.plain_ground:
        return _objection_of_edges(voted.confirmed(known.deciding), confirmed["maps"])
    return ""


def denied_by_both(known: Known, voted: Witnessed) -> bool:
    """Whether own maps surely lie on photos' edges more, and meet silhouettes better, than votes.

    Both count at once: on textured ground a leak's outline lies on edges, too, and silhouettes fill
    the gaps that maps fill.
    """
    views = known.speaking
    by_votes = overlaps(voted.maps, known.predicted)
    pairs = ((known.own.on_edges, voted.on_edges), (known.by_outline, by_votes))
    return all(surely_larger(*([one[k] for k in views] for one in pair)) for pair in pairs)


def denied_views(known: Known, certain: Witnessed, voted: Witnessed) -> list[bool]:
    """Return which views' evidence is against their votes: all, where both witnesses deny them.

    The photo does not confirm the voted outline and silhouettes meet the map better than votes do;
    or the view was held out and splats surely show it worse than those they were trained on.
    """
    all_views = denied_by_both(known, voted)
    strange = _unlike_trained(voted.met, known.by_outline, known.deciding)
    seen = known.own.on_edges, voted.on_edges, certain.met, known.by_outline, strange
    return [
        all_views or alien or (by_edges < own_edges - UNCONFIRMED and by_votes < by_outline)
        for own_edges, by_edges, by_votes, by_outline, alien in zip(*seen, strict=True)
    ]


def share_left(known: Known, masks: Sequence[SoftMap]) -> float:
    """Return the share of the photos' own maps that masks [H, W] of all views leave; 1 of none.

    The agreement of others' votes does not see what the ground's cut takes away.
    """
    shares = [float((masks[k][known.own.maps[k] >= HALF] >= HALF).mean()) for k in known.speaking]
    return float(np.mean(shares)) if shares else 1.0


def _objection_of_agreement(silhouettes: float, votes: float, confirmed: dict[str, float]) -> str:
    """Say why votes are not used; empty where they are."""
    if votes * confirmed["votes"] >= silhouettes * confirmed["maps"]:
        return ""
    return (
        f"votes meet the photos' maps to {votes:.2f} and the photos' edges to "
        f"{confirmed['votes']:.2f}, less than silhouettes, {silhouettes:.2f}, and maps, "
        f"{confirmed['maps']:.2f}, do"
    )


def _objection_of_edges(votes: float, maps: float) -> str:
    """Say why votes are not used on plain ground; empty where they are.

    What is an edge there is the object's, and splats hang in front of the ground as they please:
    maps whose outlines lie on edges need no votes.
    """
    if maps < GOOD and votes >= maps:
        return ""
    return f"on plain ground the photos' edges confirm the outlines of the maps to {maps:.3f}, " + (
        f"those of the votes to {votes:.3f}" if maps < GOOD else "which leaves nothing to mend"
    )


def _unlike_trained(
    by_votes: Sequence[float], by_outline: Sequence[float], deciding: Sequence[int]
) -> list[bool]:
    """Return which held-out views the splats surely show worse than those they were trained on.

    There votes meet the own map less than silhouettes do, by a factor below the range in which
    one more view like the training views lies (``lowest_expected``). A map that shares less with
    silhouettes than it differs is no witness.
    """
    ratios = np.log(np.maximum(by_votes, LEAST) / np.maximum(by_outline, LEAST))
    trained = set(deciding)
    held_out = [index for index in range(len(ratios)) if index not in trained]
    lowest = min(0.0, lowest_expected([ratios[index] for index in deciding], len(held_out)))
    return [
        index not in trained and outline >= CONTRADICT and bool(ratio < lowest)
        for index, (ratio, outline) in enumerate(zip(ratios, by_outline, strict=True))
    ]
