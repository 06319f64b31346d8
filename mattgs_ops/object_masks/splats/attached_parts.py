"""What belongs to an object because it is attached to it, whatever a saliency network finds.

A network misses parts in every photo (a mast's head, a dark face, a lamp) and finds things that
only look like parts. Splats know more: two of them touch where their ellipsoids, ``TOUCH``
deviations large, meet along the line between their centres. Above the ground that the object stands
on, this graph falls apart into things:

1. Splats that the views' votes are certain about are the core. Pieces of it that touch nothing of
   the largest one and lie wholly outside the object's radius are no longer certain: other things,
   or the head of a mast of which votes are not sure.
2. What is not core falls into connected parts. A part joins when more of its touches are with
   the core than with what cannot be object: ground, or what is far away. A mast's head touches the
   mast alone, and is clear; a box beside the object touches the ground along all its foot. Parts
   that touch both are less sure than clear ones: a foot, or the table beside the object.

Only solid, seen splats make the graph. Fainter ones keep the votes' label, and join where the
solid one nearest to them did. (Taking them by the nearest solid one alone draws a haze around
outlines: the same IoU, half as much again in MAE.)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.densify import rotation_matrices

TOUCH = 2.0  # deviations: where a splat has faded to an eighth
NEIGHBOURS = 24  # tried for touches; with twelve, dense spots are islands of their own
FAR = 2.5  # radii from the object's middle: nothing farther joins
RIM = 0.5  # radii beyond that, where splats still count as what a part touches
STRANDED = 1.0  # radii: pieces of the core that begin farther out are other things

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Touches:
    """Pairs of splats that touch: ``first`` [E] and ``second`` [E], each pair once or twice."""

    first: Indices
    second: Indices

    def parts(self, among: Flags) -> Indices:
        """Return the number [N] of the connected part that each splat of ``among`` [N] is in.

        Every other splat is a part by itself.
        """
        both = among[self.first] & among[self.second]
        ones = np.ones(int(both.sum()), dtype=np.int8)
        graph = coo_array((ones, (self.first[both], self.second[both])), shape=(len(among),) * 2)
        numbers: Indices = connected_components(graph, directed=False)[1].astype(np.int64)
        return numbers

    def counts(self, parts: Indices, inside: Flags, outside: Flags) -> Indices:
        """Count, for each part [P], touches between its ``inside`` [N] and ``outside`` [N]."""
        total = np.zeros(int(parts.max(initial=-1)) + 1, dtype=np.int64)
        for one, other in ((self.first, self.second), (self.second, self.first)):
            across = inside[one] & outside[other]
            total += np.bincount(parts[one[across]], minlength=len(total))
        return total


@dataclass(frozen=True)
class Attached:
    """Which splats [N] are the object's: with all parts that join, and with clear ones alone."""

    whole: Flags
    clear: Flags


def attached(
    splats: Splats, certain: Flags, solid: Flags, raised: Flags, distances: Floats
) -> Attached:
    """Return which splats [N] are the object's.

    ``certain``: the votes say so; ``solid``: opaque enough, and seen; ``raised``: above the ground;
    ``distances`` from the object's middle, in its radii.
    """
    index = np.flatnonzero(solid & (distances < FAR + RIM))
    allowed = raised & (distances < FAR)
    if not (certain & allowed)[index].any():
        return Attached(certain & allowed, certain & allowed)
    means = splats.means.numpy().astype(np.float64)
    touches = touching(means[index], spreads(splats)[index])
    chosen = grown(touches, (certain & allowed)[index], allowed[index], distances[index])
    faint = np.setdiff1d(np.flatnonzero(allowed), index)
    nearest = cKDTree(means[index]).query(means[faint])[1]
    dropped = (certain & allowed)[index] & ~chosen.core
    kept = certain[faint] & ~dropped[nearest]

    def belonging(joined: Flags) -> Flags:
        belongs = np.zeros(len(means), dtype=np.bool_)
        belongs[index] = chosen.core | joined
        belongs[faint] = joined[nearest] | kept
        return belongs

    return Attached(belonging(chosen.joined), belonging(chosen.clear))


def without_stranded(splats: Splats, certain: Flags, solid: Flags, distances: Floats) -> Flags:
    """Return the certain splats [N] but for pieces that are other things; nothing joins.

    For an object whose ground is not cut away: on it parts would join without end.
    """
    return attached(splats, certain, solid, certain, distances).whole


@dataclass(frozen=True)
class Grown:
    """Which splats [N] are the core, which joined it, and which of these touch nothing else."""

    core: Flags
    joined: Flags
    clear: Flags


def grown(touches: Touches, certain: Flags, allowed: Flags, distances: Floats) -> Grown:
    """Let parts join the core as the module's docstring says; all arguments are [N]."""
    parts = touches.parts(certain)
    sizes = np.bincount(parts[certain], minlength=int(parts.max()) + 1)
    begins = np.full(len(sizes), np.inf)
    np.minimum.at(begins, parts, distances)
    main = np.arange(len(sizes)) == int(sizes.argmax())
    core: Flags = certain & (main | (begins < STRANDED))[parts]
    rest = allowed & ~core
    never = ~core & ~rest
    parts = touches.parts(rest)
    with_core, with_never = (touches.counts(parts, rest, other) for other in (core, never))
    joined = rest & (with_core > with_never)[parts]
    return Grown(core, joined, joined & (with_never == 0)[parts])


def touching(means: Floats, spreads: Floats, neighbours: int = NEIGHBOURS) -> Touches:
    """Find which of the splats touch: ``means`` [N, 3], ``spreads`` [N, 3, 3] with Σ = S Sᵀ.

    Only each splat's nearest ``neighbours`` are tried.
    """
    count = min(neighbours, len(means) - 1)
    distances, found = cKDTree(means).query(means, k=np.arange(2, count + 2))
    first = np.repeat(np.arange(len(means), dtype=np.int64), count)
    second, lengths = found.ravel().astype(np.int64), distances.ravel()
    ways = (means[second] - means[first]) / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    deviations = [_deviation(spreads[which], ways) for which in (first, second)]
    near = lengths <= TOUCH * (deviations[0] + deviations[1])
    return Touches(first[near], second[near])


def spreads(splats: Splats) -> Floats:
    """Return rotation times scales [N, 3, 3], whose product with its transpose is Σ."""
    turned = rotation_matrices(splats.quaternions) * splats.log_scales.exp()[:, None, :]
    found: Floats = turned.numpy().astype(np.float64)
    return found


def _deviation(spreads: Floats, ways: Floats) -> Floats:
    """Return the standard deviation [E] of each Gaussian along a direction [E, 3] of length 1."""
    along: Floats = np.linalg.norm(np.einsum("nij,ni->nj", spreads, ways), axis=1)
    return along
