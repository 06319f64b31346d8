"""Stages as Prefect sees them."""

from tasks import prefect_tasks
from tasks.stages.stage import Cell


def test_a_run_has_its_name_before_it_starts_and_when_it_has() -> None:
    cell = Cell("rover", "nobg-ours+", 0)
    named = prefect_tasks.named(prefect_tasks.train, cell)
    assert named.name == "train rover nobg-ours+ seed 0"
    assert isinstance(named.task_run_name, str)
    assert named.task_run_name.format(cell=cell) == named.name


def test_a_stage_that_was_named_is_the_same_stage() -> None:
    stage, named = prefect_tasks.sfm, prefect_tasks.named(prefect_tasks.sfm, "rover")
    assert named.fn is stage.fn
    assert (named.retries, named.retry_condition_fn) == (stage.retries, stage.retry_condition_fn)
    assert (named.cache_policy, named.persist_result) == (stage.cache_policy, stage.persist_result)
