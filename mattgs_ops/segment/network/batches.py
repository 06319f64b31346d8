"""Batches for the segmenter's training: composites and folders, mixed, augmented, reproducible.

A batch follows from the seed, the step and the number of lanes alone, so that a resumed training
sees what an uninterrupted one would have seen. Composites are costlier to draw than to augment:
each step draws a few new ones and shows older ones again, changed differently. Several processes
that draw are lanes: of L lanes the steps s, s + L, s + 2L, … are one, and share their composites
with no other.
"""

from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.mask_files import decode_mask, find_mask
from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.augment import augment
from mattgs_ops.segment.network.preprocess import network_input
from mattgs_ops.segment.network.train_config import FolderConfig, SegmentTrainConfig
from mattgs_ops.segment.training_images.composites import Composites, Image
from mattgs_ops.segment.training_images.textures import Bank
from mattgs_ops.segment.training_images.traced.backdrops import Backdrop, load_backdrops

MARGIN = 1.15  # composites are drawn larger by this, so that a crop still has the full resolution
PHOTO_SUFFIXES = {".jpg", ".jpeg", ".png"}
VALIDATION_SEED_SHIFT = 1_000_003  # keeps validation composites apart from training's


class Folder:
    """A user's photos and masks, checked once, read when needed, longest side ``rescale``."""

    def __init__(self, config: FolderConfig, rescale: int, pasted: float = 0.0) -> None:
        if not config.images.is_dir():
            raise InputError(f"{config.images}: expected a folder of photos, found none")
        self.share, self.rescale, self.pasted = config.share, rescale, pasted
        names = sorted(p for p in config.images.iterdir() if p.suffix.lower() in PHOTO_SUFFIXES)
        if not names:
            raise InputError(f"{config.images}: expected photos (.jpg, .png), found none")
        self.pairs = [(photo, find_mask(config.masks, photo.name)) for photo in names]

    def sample(self, index: int) -> tuple[Image, Image]:
        """Read a pair: image [H, W, 3] RGB and mask [H, W], both uint8."""
        photo, mask_path = self.pairs[index % len(self.pairs)]
        image = cv2.imread(str(photo))
        if image is None:
            raise InputError(f"{photo}: expected a readable photo, found something else")
        mask = decode_mask(mask_path, (image.shape[1], image.shape[0]))
        factor = self.rescale / max(mask.shape)
        size = (max(1, round(mask.shape[1] * factor)), max(1, round(mask.shape[0] * factor)))
        image = cv2.resize(image[..., ::-1], size, interpolation=cv2.INTER_AREA)
        return image, cv2.resize(mask, size, interpolation=cv2.INTER_AREA)


class Batches:
    """Training batches by step, and the fixed validation set.

    ``lanes`` is the configuration's number of ``workers``, at least 1.
    """

    def __init__(self, config: SegmentTrainConfig, rendered: Path | None = None) -> None:
        self.config, self.lanes = config, max(1, config.workers)
        self.folders = [Folder(folder, config.rescale) for folder in config.folders]
        self.backdrops: tuple[Backdrop, ...] = ()
        self.backdrop_share = 0.0
        if config.rendered and rendered:
            traced = FolderConfig(
                images=rendered / "images", masks=rendered / "masks", share=config.rendered.share
            )
            self.folders.insert(0, Folder(traced, config.rescale, config.rendered.pasted))
            self.backdrops = load_backdrops(rendered)
            self.backdrop_share = config.rendered.backdrops
        self.bank = Bank(config.seed, config.patterns)
        self._validation: dict[int, list[tuple[Image, Image]]] = {}
        self._drawn: OrderedDict[tuple[int, int], tuple[Image, Image]] = OrderedDict()

    def at(self, step: int) -> tuple[Image, Image]:
        """Return images [B, S, S, 3] RGB and masks [B, S, S] of a step, uint8, 255 is object."""
        start, stage = 0, self.config.stages[0]
        for stage in self.config.stages:
            if step < start + stage.steps:
                break
            start += stage.steps
        rng = np.random.default_rng((self.config.seed, step))
        fresh = -(-stage.batch // self.config.reuse)
        first = start + (step - start) % self.lanes  # this lane's first step of the leg
        newest = fresh * ((step - first) // self.lanes + 1)
        oldest = max(0, newest - max(fresh, self.config.pool // self.lanes))
        images, masks = [], []
        for slot in range(stage.batch):
            folder = self._folder(rng)
            if folder is None:
                again = slot >= fresh
                index = int(rng.integers(oldest, newest)) if again else newest - 1 - slot
                turn, place = divmod(index, fresh)
                drawn = fresh * (first + turn * self.lanes) + place
                image, mask = self._composite(drawn, stage.size)
            else:
                image, mask = folder.sample(int(rng.integers(len(folder.pairs))))
                if folder.pasted and rng.random() < folder.pasted:
                    image = self._pasted(rng, image, mask)
            image, mask = augment(rng, image, mask, stage.size, self.config.augment)
            images.append(image)
            masks.append(mask)
        return np.stack(images), np.stack(masks)

    def validation(self, size: int) -> list[tuple[Image, Image]]:
        """Return the validation set, drawn once: composites of another seed."""
        if size not in self._validation:
            source = self._source(self.config.seed + VALIDATION_SEED_SHIFT, size)
            indices = range(self.config.validation_images)
            self._validation[size] = [source.sample(index) for index in indices]
        return self._validation[size]

    def _pasted(self, rng: np.random.Generator, image: Image, mask: Image) -> Image:
        """Put the object of a traced view before another place, as cut-and-paste training does.

        Dwibedi, Misra and Hebert, Cut, Paste and Learn (ICCV 2017). No shadow is drawn.
        """
        place = self.backdrops[int(rng.integers(len(self.backdrops)))].image
        size = (mask.shape[1], mask.shape[0])
        behind = cv2.resize(place, size, interpolation=cv2.INTER_LINEAR)
        if rng.random() < 0.5:
            behind = behind[:, ::-1]
        share = mask[..., None].astype(np.float32) / 255
        return np.asarray(image * share + behind * (1 - share), dtype=np.uint8)

    def _folder(self, rng: np.random.Generator) -> Folder | None:
        draw = rng.random() * (1.0 if self.config.composites else self._shares())
        for folder in self.folders:
            draw -= folder.share
            if draw < 0:
                return folder
        return None if self.config.composites else self.folders[-1]

    def _shares(self) -> float:
        return sum(folder.share for folder in self.folders)

    def _composite(self, index: int, size: int) -> tuple[Image, Image]:
        key = (index, size)
        if key not in self._drawn:
            drawn = round(size * MARGIN)
            self._drawn[key] = self._source(self.config.seed, drawn).sample(index)
            while len(self._drawn) > self.config.pool + 64:
                self._drawn.popitem(last=False)
        return self._drawn[key]

    def _source(self, seed: int, size: int) -> Composites:
        return Composites(
            seed, size, self.bank, self.backdrops, self.backdrop_share, self.config.world
        )


def unseen_inputs(config: SegmentTrainConfig, count: int, size: int) -> NDArray[np.float32]:
    """Return network inputs [count, 3, size, size] of composites of another seed than training's.

    They are changed as in training, and each is shown once; folders and traced views are left out.
    """
    seed = config.seed + VALIDATION_SEED_SHIFT
    source = Composites(
        seed, round(size * MARGIN), Bank(config.seed, config.patterns), world=config.world
    )
    rng = np.random.default_rng(seed)
    drawn = (augment(rng, *source.sample(k), size, config.augment) for k in range(count))
    return np.stack([network_input(image, size, size) for image, _ in drawn])
