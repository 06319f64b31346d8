"""Which experiments and stages a benchmark has, planned and as they stand.

Light, for those who only count or name them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mattgs_ops.config import BenchmarkConfig, Condition
from tasks.stages.stage import Cell
from tasks.stages.status import State, Status

# An experiment is what the first of these says that holds for one of its stages.
FIRST: tuple[State, ...] = ("failed", "interrupted", "running")
OF_A_CAPTURE = ("prepare", "segment", "sfm", "agree")
OF_AN_EXPERIMENT = ("train", "evaluate")
TRUTH = "truth"  # once per capture and background
SPEED = "measure"  # once per capture, last


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


@dataclass(frozen=True)
class Experiment:
    """One experiment: its name, and the status of its stages by their kind.

    ``over``: the run has ended, so that what waits will not begin.
    """

    name: str
    stages: dict[str, Status]
    over: bool = False

    @property
    def state(self) -> State:
        """State of the experiment, from those of its stages."""
        states = [stage.state for stage in self.stages.values()]
        for state in FIRST:
            if state in states:
                return state
        if "waiting" in states:
            if self.over:
                return "interrupted"
            return "waiting" if states.count("waiting") == len(states) else "running"
        return "cached" if set(states) == {"cached"} else "done"


def experiments(stages: Sequence[Status], *, over: bool = False) -> list[Experiment]:
    """Sort stages to the experiments that need them; those of a capture count for each.

    ``over`` as in :class:`Experiment`.
    """
    by_title = {stage.title: stage for stage in stages}
    result = []
    for stage in sorted(stages, key=lambda stage: stage.title):
        if stage.stage != "train":
            continue
        name = stage.title.removeprefix("train ")
        capture = name.partition(" ")[0]
        titles = {kind: f"{kind} {capture}" for kind in (*OF_A_CAPTURE, SPEED)}
        titles |= {kind: f"{kind} {name}" for kind in OF_AN_EXPERIMENT}
        background = name.partition(" ")[2].partition("-")[0]
        titles[TRUTH] = f"{TRUTH} {capture} {background}"
        order = (*OF_A_CAPTURE, OF_AN_EXPERIMENT[0], TRUTH, *OF_AN_EXPERIMENT[1:], SPEED)
        stages_of_one = {kind: by_title[titles[kind]] for kind in order if titles[kind] in by_title}
        result.append(Experiment(name, stages_of_one, over))
    return result


def without_lost(stages: Sequence[Status]) -> list[Status]:
    """Leave out what waits and will never run: only experiments that failed would need it."""
    of_failed: set[str] = set()
    needed: set[str] = set()
    for one in experiments(stages):
        titles = {stage.title for stage in one.stages.values()}
        if one.state == "failed":
            of_failed |= titles
        else:
            needed |= titles
    lost = of_failed - needed
    return [one for one in stages if one.state != "waiting" or one.title not in lost]
