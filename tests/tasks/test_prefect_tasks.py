"""Stages as Prefect sees them."""

import pytest

from mattgs_ops.config import BenchmarkConfig, RunConfig
from tasks import prefect_tasks
from tasks.stages.stage import Cell

CONFIG = BenchmarkConfig(name="night", run=RunConfig(retries=4))


def test_a_run_has_its_name_before_it_starts_and_when_it_has() -> None:
    cell = Cell("rover", "nobg-ours+", 0)
    train = prefect_tasks.configured(prefect_tasks.train, cell, CONFIG)
    assert train.name == "train rover nobg-ours+ seed 0"
    assert isinstance(train.task_run_name, str)
    assert train.task_run_name.format(cell=cell) == train.name


def test_a_configured_stage_is_the_same_stage_with_the_benchmarks_retries() -> None:
    stage = prefect_tasks.sfm
    own = prefect_tasks.configured(stage, "rover", CONFIG)
    assert own.fn is stage.fn
    assert (own.retries, own.retry_condition_fn) == (4, prefect_tasks.crashed)
    assert (own.cache_policy, own.persist_result) == (stage.cache_policy, stage.persist_result)


@pytest.mark.parametrize(
    ("owner", "expected"),
    [
        ("rover", {"capture:rover"}),
        (Cell("rover", "nobg-3dgs", 2), {"capture:rover", "condition:nobg-3dgs", "seed:2"}),
    ],
)
def test_tags_say_what_a_run_belongs_to(owner: str | Cell, expected: set[str]) -> None:
    tags = prefect_tasks.tags("evaluate", owner, "night")
    assert tags == {"stage:evaluate", "benchmark:night"} | expected
