"""Which photos are held out, where the capture itself says so.

nerfstudio writes ``train_filenames``, ``val_filenames`` and ``test_filenames`` into
``transforms.json``. Beside COLMAP models lie lists of names, one a line: ``train_list.txt``,
``val_list.txt`` and ``test_list.txt`` for nerfstudio, ``train.txt`` and ``test.txt`` elsewhere (the
original 3DGS release reads ``sparse/0/test.txt``).

The test list is what is scored; where there is none, the validation list is. Photos in no list are
training views when only one of both is given, and are left out when both are.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mattgs_ops.capture.scene import Split
from mattgs_ops.errors import InputError

FILES = {
    "train": ("train_list.txt", "train.txt"),
    "validation": ("val_list.txt", "val.txt"),
    "test": ("test_list.txt", "test.txt"),
}
# NeRF's own layout: frames with their cameras, a file per split
NERF_LISTS = {
    "train": "transforms_train.json",
    "validation": "transforms_val.json",
    "test": "transforms_test.json",
}
LIST_FILES = frozenset(name for names in FILES.values() for name in names)
MOST_NAMED = 5  # photos in one message


@dataclass(frozen=True)
class SplitLists:
    """Names of photos as a capture lists them; None: there is no such list."""

    train: tuple[str, ...] | None
    validation: tuple[str, ...] | None
    test: tuple[str, ...] | None
    where: str  # what to name in messages
    files: tuple[Path, ...] = ()

    @property
    def any(self) -> bool:
        """Whether there is a list at all."""
        return not self.train is self.validation is self.test is None

    def assign(self, photos: Mapping[str, Path]) -> tuple[dict[Path, Split], tuple[Path, ...]]:
        """Return which view each photo is, and the photos that are left out.

        ``photos`` maps every name under which a photo may be listed to its file. Raises
        :class:`InputError` for names of no photo, photos in both lists, and an empty part.
        """
        train, validation, test = (
            None if names is None else self._files(names, photos)
            for names in (self.train, self.validation, self.test)
        )
        everything = list(dict.fromkeys(photos.values()))
        held_out = test or validation
        if held_out is None:
            held_out = _without(everything, train or [])
        elif train is None:
            train = _without(everything, [*held_out, *(validation or [])])
        both = sorted(set(train or []) & set(held_out))
        if both:
            raise InputError(f"{self.where}: {_names(both)} listed for training and for testing")
        if not (train and held_out):
            part = "test" if train else "training"
            raise InputError(f"{self.where}: leaves no {part} photos; list some")
        split: dict[Path, Split] = dict.fromkeys(train, "train")
        split |= dict.fromkeys(held_out, "test")
        return split, tuple(_without(everything, split))

    def _files(self, names: Sequence[str], photos: Mapping[str, Path]) -> list[Path]:
        unknown = [name for name in names if name not in photos]
        if unknown:
            raise InputError(
                f"{self.where}: lists {', '.join(unknown[:MOST_NAMED])}"
                f"{_more(unknown)}: no such photos; restore them or correct the list"
            )
        return [photos[name] for name in names]


def read_lists(folders: Sequence[Path]) -> SplitLists:
    """Read the text files; of several of one kind, that of the first folder counts."""
    found: dict[str, tuple[str, ...] | None] = dict.fromkeys(FILES)
    files = []
    for kind, names in FILES.items():
        places = [folder / name for folder in folders for name in names]
        path = next((place for place in places if place.is_file()), None)
        if path is not None:
            found[kind] = _lines(path)
            files.append(path)
    where = ", ".join(str(path) for path in files)
    return SplitLists(found["train"], found["validation"], found["test"], where, tuple(files))


def listed_names(photo: Path, folders: Sequence[Path]) -> list[str]:
    """Return the names under which a photo may be listed: below each of ``folders``."""
    return [
        photo.relative_to(folder).as_posix() for folder in folders if photo.is_relative_to(folder)
    ]


def _lines(path: Path) -> tuple[str, ...]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected a list of photos' names: {error}") from error
    stripped = (line.strip() for line in lines)
    return tuple(line for line in stripped if line and not line.startswith("#"))


def _without(photos: Iterable[Path], others: Iterable[Path]) -> list[Path]:
    gone = set(others)
    return [photo for photo in photos if photo not in gone]


def _names(photos: Sequence[Path]) -> str:
    return ", ".join(photo.name for photo in photos[:MOST_NAMED]) + _more(photos)


def _more(items: Sequence[object]) -> str:
    return f" and {len(items) - MOST_NAMED} more" if len(items) > MOST_NAMED else ""
