"""Which experiments and stages a benchmark has; light, for those who only count or name them."""

from collections.abc import Iterator

from mattgs_ops.config import BenchmarkConfig, Condition
from tasks.stages.stage import Cell


def cells(config: BenchmarkConfig, capture: str) -> Iterator[Cell]:
    """Yield a capture's experiments, seed by seed."""
    for seed in config.seeds:
        for condition in config.conditions:
            for budget in config.budgets_of(condition):
                yield Cell(capture, condition, seed, budget)


def stages(config: BenchmarkConfig) -> Iterator[tuple[str, str]]:
    """Yield the kind and the title of every stage that the benchmark has when nothing fails."""
    votes = ("agree",) if config.segment.refine == "votes" else ()
    for capture in config.captures:
        for kind in ("prepare", "segment", "sfm", *votes):
            yield kind, f"{kind} {capture.name}"
        for background in dict.fromkeys(Condition.parse(c).background for c in config.conditions):
            yield "truth", f"truth {capture.name} {background}"
        for cell in cells(config, capture.name):
            yield "train", f"train {cell}"
            yield "evaluate", f"evaluate {cell}"
        yield "measure", f"measure {capture.name}"
