"""A COLMAP project as a capture: photos with the poses of its model, and their split."""

from pathlib import Path

from mattgs_ops.capture.formats.colmap_model import model_files, read_model
from mattgs_ops.capture.formats.posed import PosedCapture, PosedPhoto, path_inside, raise_all
from mattgs_ops.errors import InputError


def model_folder(root: Path) -> Path | None:
    """Return the folder of the model below ``root/sparse``, None if there is none.

    ``sparse/0`` goes first, which COLMAP's mapper fills, then ``sparse``, then any other.
    """
    sparse = root / "sparse"
    folders = [sparse / "0", sparse, *sorted(p.parent for p in sparse.glob("*/cameras.*"))]
    return next((f for f in folders if any(f.glob("cameras.*"))), None)


def read_colmap(model: Path, images: Path) -> PosedCapture:
    """Read cameras and poses of a COLMAP model, with its photos' paths below ``images``.

    Raises :class:`InputError` for a model that is not there, damaged or of an unread camera type,
    and for registered photos whose file is absent or outside of ``images``.
    """
    found = read_model(model, with_points=False)
    files = model_files(model)
    photos, problems = dict[Path, PosedPhoto](), []
    for image in found.images.values():
        try:
            path = path_inside(images, image.name, str(files[1]))
        except InputError as error:
            problems.append(str(error))
            continue
        if not path.is_file():
            problems.append(f"{path}: registered in {model} but missing; restore the file")
        elif path in photos:
            problems.append(f"{model}: {image.name} listed more than once; rename or remove")
        lens = found.cameras[image.camera].lens()
        photos[path] = PosedPhoto(path, lens, image.rotation, image.translation)
    raise_all(problems)
    points = model if len(files) > 2 else None
    return PosedCapture(tuple(photos[p] for p in sorted(photos)), points=points, read=tuple(files))
