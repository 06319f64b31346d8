"""A saliency network in ONNX Runtime: photos in, soft maps out.

Works with the bundled three of U²-NetP and with any ONNX file of U²-Net's convention: one input
[N, 3, H, W] float32, the first output the fused map [N, 1, H, W]. Size and names are read from the
file. Of a file that combines networks (``ensemble``), what each says by itself is in outputs of the
same shape, named ``saliency/1``, ``saliency/2``, …; other outputs are passed over.
"""

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.network.preprocess import network_input
from mattgs_ops.segment.onnx_files.onnx_file import BUNDLED, open_model

# made by ``mattgs segment quantize`` and ``combine`` of three networks beside it
BUNDLED_MODEL = BUNDLED / "u2netp-trio.onnx"
DEFAULT_SIZE = 320  # for files that leave the size open; what U²-Net was published with
LEAST_CONTRAST = 0.05  # of probability; a map flatter than this has found nothing
SALIENCY = "saliency"  # the output of files made here; what their networks say is "saliency/1", …
BATCH = 4  # photos at a time; memory grows with it, speed hardly


class SaliencyNetwork:
    """An ONNX file, checked. Raises :class:`InputError` for a file that is no such network."""

    def __init__(self, path: Path, *, threads: int = 1) -> None:
        self.path = path
        self._session = open_model(path, threads, "a segmentation model")
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        shape = inputs[0].shape if len(inputs) == 1 else []
        if not _fits(shape, channels=3) or inputs[0].type != "tensor(float)":
            found = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs) or "none"
            raise InputError(f"{path}: expected one float32 input [N, 3, H, W], found {found}")
        if not outputs or not _fits(outputs[0].shape, channels=1):
            found = ", ".join(f"{o.name} {o.shape}" for o in outputs) or "none"
            raise InputError(f"{path}: expected a first output [N, 1, H, W], found {found}")
        single = [o.name for o in outputs if re.fullmatch(rf"{SALIENCY}/\d+", o.name)]
        self.input, self.outputs = inputs[0].name, [outputs[0].name, *single]
        sides = [s if isinstance(s, int) and s > 0 else DEFAULT_SIZE for s in shape[2:]]
        self.height, self.width = sides
        self.batch = shape[0] if isinstance(shape[0], int) and shape[0] > 0 else BATCH

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    def soft_maps(self, photos: Sequence[NDArray[np.uint8]], names: Sequence[str]) -> list[SoftMap]:
        """Photos [H, W, 3] RGB to maps [H, W] in 0..1, each stretched to the whole range.

        A photo in which nothing was found gets a map of zeros. Raises :class:`StageError` naming
        the photo whose map is not finite.
        """
        return [maps[0] for maps in self.all_maps(photos, names)]

    def all_maps(
        self, photos: Sequence[NDArray[np.uint8]], names: Sequence[str]
    ) -> list[list[SoftMap]]:
        """As :meth:`soft_maps`, and for each photo also what each network of the file says."""
        inputs = [network_input(photo, self.width, self.height) for photo in photos]
        raw: list[NDArray[np.float32]] = []  # [outputs, H, W] of each photo
        for start in range(0, len(inputs), self.batch):
            chunk = inputs[start : start + self.batch]
            padding = [chunk[-1]] * (self.batch - len(chunk)) if self._fixed_batch else []
            answers = self._answers(np.stack([*chunk, *padding]), self.outputs)
            raw.extend(answers.swapaxes(0, 1)[: len(chunk)])
        return [
            [stretched(one, photo.shape[1], photo.shape[0], name) for one in said]
            for said, photo, name in zip(raw, photos, names, strict=True)
        ]

    @property
    def _fixed_batch(self) -> bool:
        return isinstance(self._session.get_inputs()[0].shape[0], int)

    def raw_maps(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Network inputs [N, 3, H, W] to what the file says of them, [N, H, W].

        Raises :class:`StageError` when the model fails, :class:`InputError` for another shape.
        """
        answers: NDArray[np.float32] = self._answers(inputs, self.outputs[:1])[0]
        return answers

    def _answers(self, inputs: NDArray[np.float32], outputs: Sequence[str]) -> NDArray[np.float32]:
        """Return the ``outputs`` [O, N, H, W] of the file; see :meth:`raw_maps`."""
        try:
            raw = self._session.run(list(outputs), {self.input: inputs})
        except Exception as error:  # ONNX Runtime's own types are not public
            raise StageError(f"{self.path}: the model failed on {inputs.shape}: {error}") from error
        expected = (len(inputs), 1, *inputs.shape[2:])
        for name, one in zip(outputs, raw, strict=True):
            if tuple(one.shape) != expected:
                raise InputError(
                    f"{self.path}: expected output {name} of {list(expected)}, "
                    f"found {list(one.shape)}"
                )
        return np.stack([one[:, 0] for one in raw]).astype(np.float32, copy=False)


def _fits(shape: Sequence[object], *, channels: int) -> bool:
    """Whether a declared shape can be [N, channels, H, W]; names and None leave a size open."""
    return len(shape) == 4 and (not isinstance(shape[1], int) or shape[1] == channels)


def stretched(raw: NDArray[np.float32], width: int, height: int, name: str) -> SoftMap:
    """Min–max a map to 0..1 and resize it to the photo; one that shows nothing becomes all 0.

    Raises :class:`StageError` naming the photo where the map is not finite.
    """
    low, high = float(raw.min()), float(raw.max())
    if not np.isfinite(low + high):
        raise StageError(
            f"{name}: expected a map of finite numbers, found one between {low:.3g} and {high:.3g}"
        )
    if high - low < LEAST_CONTRAST:
        return np.zeros((height, width), np.float32)
    scaled = (raw - low) / (high - low)
    resized = cv2.resize(scaled, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(resized, 0, 1), dtype=np.float32)
