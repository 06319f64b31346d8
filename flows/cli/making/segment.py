"""``mattgs segment …``. Light at the top, as ``flows/cli/app.py``, which registers them."""

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.arguments import DEFAULT_OUT, Out

segment_app = typer.Typer(help="The networks that cut objects out.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.add_typer(segment_app, name="segment")


@segment_app.command("train")
def train_segmenter(
    folder: Annotated[Path, typer.Argument(help="Folder for weights, curve and ONNX file.")],
    config: Annotated[Path | None, typer.Option(help="Training as a TOML file.")] = None,
    start_from: Annotated[
        Path | None, typer.Option(help="Weights (.pth) to go on from.", exists=True, dir_okay=False)
    ] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Train U²-Net, with its curve in MLflow, and export it to ONNX.

    An interrupted training goes on from its checkpoint. `segment.model` takes the ONNX file.
    """
    from flows.cli.terminal import bar
    from flows.services import embedded, registries
    from mattgs_ops.segment.network.train_config import SegmentTrainConfig, load_train_config
    from tasks.train_segmenter import train_segmenter as train

    settings = SegmentTrainConfig() if config is None else load_train_config(config)
    if start_from is not None:
        settings = settings.model_copy(update={"start_from": start_from})
    embedded.enter(out)
    with bar("train U²-Net") as progress:
        onnx = train(settings, folder, registries.current(out), out, progress=progress)
    typer.echo(f"Segmenter: {onnx.resolve()}")


@segment_app.command("quantize")
def quantize_network(
    onnx: Annotated[Path, typer.Argument(help="The ONNX file to write.")],
    network: Annotated[
        Path, typer.Argument(help="The ONNX file of one network.", exists=True, dir_okay=False)
    ],
    config: Annotated[Path, typer.Option(help="The TOML file of its training.")],
    outline: Annotated[bool, typer.Option("--outline", help="It moves outlines.")] = False,
    images: Annotated[int, typer.Option(min=2, help="How many it is fitted to.")] = 128,
) -> None:
    """Make an ONNX file of a network that computes in eight bits.

    It is fitted to composites as in its training, of another seed. Such a file is faster on CPUs
    with VNNI, and no slower on others.
    """
    from mattgs_ops.segment.network.batches import unseen_inputs
    from mattgs_ops.segment.network.saliency import SaliencyNetwork
    from mattgs_ops.segment.network.train_config import load_train_config
    from mattgs_ops.segment.onnx_files.quantize import quantize
    from mattgs_ops.segment.outline.images import unseen_crops
    from mattgs_ops.segment.outline.train_config import load_outline_config

    if outline:
        inputs = unseen_crops(load_outline_config(config), images)
    else:
        inputs = unseen_inputs(load_train_config(config), images, SaliencyNetwork(network).width)
    difference = quantize(network, inputs, onnx)
    typer.echo(f"Network: {onnx.resolve()} (mean difference of its maps {difference:.1g})")


@segment_app.command("combine")
def combine_segmenters(
    onnx: Annotated[Path, typer.Argument(help="The ONNX file to write.")],
    networks: Annotated[
        list[Path], typer.Argument(help="Two or more ONNX files.", exists=True, dir_okay=False)
    ],
) -> None:
    """Make one ONNX file of several networks: it gives the mean of their maps."""
    from mattgs_ops.segment.network.ensemble import combine

    difference = combine(networks, onnx)
    typer.echo(f"Segmenter: {onnx.resolve()} (within {difference:.1g} of the mean)")


@segment_app.command("outline")
def train_outline(
    folder: Annotated[Path, typer.Argument(help="Folder for images, weights, curve, ONNX file.")],
    config: Annotated[Path | None, typer.Option(help="Training as a TOML file.")] = None,
    out: Out = DEFAULT_OUT,
) -> None:
    """Train the network that moves outlines to the object's, with its curve in MLflow.

    An interrupted training goes on from its checkpoint.
    """
    from flows.cli.terminal import bar
    from flows.services import embedded, registries
    from mattgs_ops.segment.outline.train_config import OutlineTrainConfig, load_outline_config
    from tasks.train_segmenter import train_outline as train

    settings = OutlineTrainConfig() if config is None else load_outline_config(config)
    embedded.enter(out)
    with bar("train the outline") as progress:
        onnx = train(settings, folder, registries.current(out), out, progress=progress)
    typer.echo(f"Outline: {onnx.resolve()}")
