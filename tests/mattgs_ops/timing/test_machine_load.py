"""Samples of CPU and memory: there, plausible, continued, and never without a last one."""

import csv
from pathlib import Path

from mattgs_ops.timing import machine_load


def read(file: Path) -> list[dict[str, float]]:
    with file.open(encoding="utf-8") as lines:
        return [{key: float(value) for key, value in one.items()} for one in csv.DictReader(lines)]


def test_a_computation_leaves_samples_that_its_machine_can_have(tmp_path: Path) -> None:
    file = tmp_path / "load.csv"
    with machine_load.sampled(file, every=0.01):
        total = sum(k * k for k in range(1_000_000))
    assert total > 0
    samples = read(file)
    assert [one["step"] for one in samples] == list(range(1, len(samples) + 1))
    assert samples[-1].keys() == {"step", "time", *machine_load.NAMES}
    for one in samples:
        assert 0 <= one["cpu_utilization_percentage"] <= 100
        assert 1 < one["process_memory_usage_megabytes"] < one["system_memory_usage_megabytes"]
    assert max(one["process_cpu_utilization_percentage"] for one in samples) > 20


def test_a_short_one_has_its_last_sample_and_a_resumed_one_goes_on(tmp_path: Path) -> None:
    file = tmp_path / "load.csv"
    for _ in range(2):
        with machine_load.sampled(file, every=1000):
            pass
    assert [one["step"] for one in read(file)] == [1, 2]
    assert file.read_text(encoding="utf-8").count("step") == 1
