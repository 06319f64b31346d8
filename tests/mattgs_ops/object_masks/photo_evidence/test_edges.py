"""Outlines are compared with the photo's edges and go to those nearby; thin things survive."""

import cv2
import numpy as np

from mattgs_ops.object_masks.photo_evidence.edges import (
    edges_near,
    share_on_edges,
    to_photo_edges,
)
from mattgs_ops.object_masks.silhouettes import iou

SIDE = 320


def disc(radius: int) -> np.ndarray:
    mask = np.zeros((SIDE, SIDE), np.uint8)
    cv2.circle(mask, (160, 160), radius, 255, -1)
    return mask


def photo_of(mask: np.ndarray) -> np.ndarray:
    """Make a reddish thing on a bluish ground, with noise."""
    photo = np.where(mask[..., None] > 0, (40, 60, 200), (180, 140, 60)).astype(np.float32)
    photo += np.random.default_rng(0).normal(0, 3, photo.shape)
    return photo.clip(0, 255).astype(np.uint8)


def test_an_outline_two_pixels_off_is_moved_to_the_edge() -> None:
    true = disc(80)
    for found in (disc(82), disc(78)):
        moved = to_photo_edges(found, photo_of(true))
        before, after = (iou(mask > 0, true > 0) for mask in (found, moved))
        assert after > before + 0.01, (before, after)
        assert after > 0.96


def test_without_an_edge_nearby_it_stays() -> None:
    found = disc(80)
    even = np.full((SIDE, SIDE, 3), 128, np.uint8)
    assert iou(to_photo_edges(found, even) > 0, found > 0) > 0.97


def test_wires_and_narrow_gaps_stay() -> None:
    mask = disc(60)
    mask[20:110, 158:161] = 255  # an aerial of three pixels
    mask[160:230, 150:152] = 0  # a gap of two
    plain = photo_of(disc(60))  # where neither can be told from what is behind
    moved = to_photo_edges(mask, plain)
    assert (moved[25:90, 158:161] == 255).all()
    assert (moved[165:210, 150:152] == 0).all()


def test_a_mask_without_an_inside_is_returned_as_it_is() -> None:
    wire = np.zeros((SIDE, SIDE), np.uint8)
    wire[:, 160:162] = 255
    assert np.array_equal(to_photo_edges(wire, photo_of(wire)), wire)


def test_an_outline_lies_on_edges_where_the_photo_has_some() -> None:
    edges = edges_near(photo_of(disc(80)))
    assert share_on_edges(disc(80) > 0, edges) > 0.95
    quiet = edges_near(cv2.GaussianBlur(photo_of(disc(80)), (0, 0), 2))
    assert share_on_edges(disc(60) > 0, quiet) == 0
    assert share_on_edges(np.zeros((SIDE, SIDE), bool), edges) == 0
