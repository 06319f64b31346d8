"""A checkpoint gives back everything, and only to the training it belongs to."""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import pytest
import torch

from mattgs_ops.errors import StageError
from mattgs_ops.splat.exposure import Exposures
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training import checkpoint
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.densify import Record
from mattgs_ops.splat.training.optimise import FIELDS

MakeSplats = Callable[[int, int], Splats]


@pytest.fixture
def state(make_splats: MakeSplats) -> TrainingState:
    """Make a state in which nothing is as it was at the start."""
    made = TrainingState.start(make_splats(6, 0), seed=3)
    random = torch.Generator().manual_seed(1)
    for moments in (made.adam.first, made.adam.second):
        for name in FIELDS:
            moments[name].normal_(generator=random)
    for field in fields(Record):
        getattr(made.record, field.name).uniform_(generator=random)
    made.adam.steps = made.step = 41
    made.order = [4, 0, 2]
    made.counters = {"added": 7}
    made.wall_seconds, made.cpu_seconds = 1.25, 2.5
    for rng in made.streams.values():
        rng.standard_normal(5, dtype="float32")  # leaves half a draw in the generator
    return made


def test_everything_comes_back_to_the_bit(state: TrainingState, tmp_path: Path) -> None:
    checkpoint.save(state, tmp_path, "key")
    found = checkpoint.load(tmp_path, "key")
    assert found is not None
    for name in FIELDS:
        assert torch.equal(getattr(found.splats, name), getattr(state.splats, name))
        assert torch.equal(found.adam.first[name], state.adam.first[name])
        assert torch.equal(found.adam.second[name], state.adam.second[name])
    for field in fields(Record):
        assert torch.equal(getattr(found.record, field.name), getattr(state.record, field.name))
    for name in ("step", "order", "counters", "wall_seconds", "cpu_seconds"):
        assert getattr(found, name) == getattr(state, name)
    assert found.adam.steps == 41
    for name, rng in found.streams.items():
        assert rng.random(9).tolist() == state.streams[name].random(9).tolist()
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.npz"]


def test_exposures_come_back_where_there_are_some(state: TrainingState, tmp_path: Path) -> None:
    state.exposures = Exposures.identity(3, 500)
    for tensor in state.exposures.tensors().values():
        tensor.uniform_(generator=torch.Generator().manual_seed(2))
    checkpoint.save(state, tmp_path, "key")
    found = checkpoint.load(tmp_path, "key")
    assert found is not None
    assert found.exposures is not None
    assert found.exposures.iterations == 500
    for name, tensor in state.exposures.tensors().items():
        assert torch.equal(found.exposures.tensors()[name], tensor)


def test_the_streams_of_one_seed_differ_from_each_other(make_splats: MakeSplats) -> None:
    streams = TrainingState.start(make_splats(2, 0), seed=0).streams
    assert len({rng.random() for rng in streams.values()}) == len(streams)


def test_another_trainings_checkpoint_is_not_used(state: TrainingState, tmp_path: Path) -> None:
    assert checkpoint.load(tmp_path, "key") is None
    checkpoint.save(state, tmp_path, "key")
    assert checkpoint.load(tmp_path, "another") is None


@pytest.mark.parametrize("cut", [0, 100, -40])
def test_a_damaged_checkpoint_is_named(state: TrainingState, tmp_path: Path, cut: int) -> None:
    checkpoint.save(state, tmp_path, "key")
    path = tmp_path / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(StageError, match=r"checkpoint\.npz"):
        checkpoint.load(tmp_path, "key")


def test_the_digest_follows_contents_and_parameters(tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    first.write_bytes(b"one")
    second.write_bytes(b"two")
    plain = checkpoint.digest([first, second], {"seed": 0})
    assert checkpoint.digest([first, second], {"seed": 0}) == plain
    assert checkpoint.digest([first, second], {"seed": 1}) != plain
    assert checkpoint.digest([first], {"seed": 0}) != plain
    second.write_bytes(b"too")
    assert checkpoint.digest([first, second], {"seed": 0}) != plain
