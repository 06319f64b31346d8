"""Which experiments a benchmark has; light, for those who only count them."""

from collections.abc import Iterator

from mattgs_ops.config import BenchmarkConfig
from tasks.stage import Cell

STAGES_OF_A_CAPTURE = 4  # prepare, segment, sfm; measure
STAGES_OF_VOTES = 1  # agree
STAGES_OF_AN_EXPERIMENT = 2  # train, evaluate


def cells(config: BenchmarkConfig, capture: str) -> Iterator[Cell]:
    """Yield a capture's experiments, seed by seed."""
    for seed in config.seeds:
        for condition in config.conditions:
            yield Cell(capture, condition, seed)


def count_stages(config: BenchmarkConfig) -> int:
    """Return how many stages the benchmark has when nothing fails."""
    captures = len(config.captures)
    experiments = captures * len(config.seeds) * len(config.conditions)
    shared = STAGES_OF_A_CAPTURE + STAGES_OF_VOTES * (config.segment.refine == "votes")
    return shared * captures + STAGES_OF_AN_EXPERIMENT * experiments
