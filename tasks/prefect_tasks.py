"""The stages as Prefect sees them: names for people, tags, retries, no cache of its own.

Prefect's result cache is off: stages are looked up in the content-addressed store, whose keys see
contents and code. Retries are for processes that were killed or crashed; an operation that says
why it failed would say the same again.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from prefect import Task, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State, TaskRun

from mattgs_ops.config import BenchmarkConfig
from tasks.agree import agree as agree_stage
from tasks.evaluate import evaluate as evaluate_stage
from tasks.measure import measure as measure_stage
from tasks.prepare import prepare as prepare_stage
from tasks.segment import segment as segment_stage
from tasks.sfm import sfm as sfm_stage
from tasks.stages.process import CrashError
from tasks.stages.stage import Cell
from tasks.train import train as train_stage

RETRY_DELAY_SECONDS = 2.0

Result = TypeVar("Result")


def crashed(task: Task[Any, Any], run: TaskRun, state: "State[Any]") -> bool:
    """Whether a failed task is worth another try."""
    del task, run
    try:
        state.result()
    except CrashError:
        return True
    except Exception:
        return False
    return False


def _stage(function: Callable[..., Result], run_name: str) -> "Task[..., Result]":
    return task(
        name=function.__name__,
        task_run_name=run_name,
        cache_policy=NO_CACHE,
        persist_result=False,
        retry_delay_seconds=RETRY_DELAY_SECONDS,
        retry_condition_fn=crashed,
    )(function)


def configured(
    stage: "Task[..., Result]", owner: str | Cell, config: BenchmarkConfig
) -> "Task[..., Result]":
    """Return a stage for one capture or one experiment of a benchmark.

    It carries its name before it starts, or if it never does: Prefect fills in a run's own name
    only when it starts. It has the benchmark's retries, and tags to search and to limit by.
    """
    return stage.with_options(
        name=f"{stage.name} {owner}",
        tags=tags(stage.name, owner, config.name),
        retries=config.run.retries,
    )


def tags(stage: str, owner: str | Cell, benchmark: str) -> set[str]:
    """Return a task run's tags, for example ``stage:train`` and ``condition:nobg-ours``.

    A concurrency limit on ``stage:train`` bounds the trainings of all benchmarks of a server.
    """
    common = {f"stage:{stage}", f"benchmark:{benchmark}"}
    if isinstance(owner, Cell):
        own = {f"capture:{owner.capture}", f"condition:{owner.condition}", f"seed:{owner.seed}"}
        return common | own
    return common | {f"capture:{owner}"}


prepare = _stage(prepare_stage, "prepare {capture.name}")
segment = _stage(segment_stage, "segment {name}")
sfm = _stage(sfm_stage, "sfm {name}")
agree = _stage(agree_stage, "agree {name}")
train = _stage(train_stage, "train {cell}")
evaluate = _stage(evaluate_stage, "evaluate {cell}")
measure = _stage(measure_stage, "measure {name}")
