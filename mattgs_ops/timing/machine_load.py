"""What a long computation takes of its machine: samples of CPU and memory in a file, by a thread.

The names are MLflow's where the meaning is MLflow's (of the machine: CPU in percent of all cores,
memory in use); those that begin with ``process`` are of this process and those that it started, 100
percent of CPU being one core.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

LOAD_FILE = "load.csv"
NAMES = (
    "cpu_utilization_percentage",
    "system_memory_usage_percentage",
    "system_memory_usage_megabytes",
    "process_cpu_utilization_percentage",
    "process_memory_usage_megabytes",
)
EVERY = 5.0  # seconds between two samples: one takes less than a millisecond
MEGABYTE = 1e6
TICK = 0.01  # seconds; the kernel counts CPU time in such steps


@contextmanager
def sampled(file: Path, every: float = EVERY) -> Iterator[None]:
    """Append samples of the machine and this process to a CSV file, the last one at the end.

    Columns are ``step`` (the sample's number), ``time`` (seconds since the epoch) and
    :data:`NAMES`. A file that is there is continued.
    """
    sampler = _Sampler(file, every)
    sampler.start()
    try:
        yield
    finally:
        sampler.end()


class _Sampler(threading.Thread):
    def __init__(self, file: Path, every: float) -> None:
        super().__init__(name="load", daemon=True)
        self._file, self._every = file, every
        self._over = threading.Event()
        self._process = psutil.Process()
        psutil.cpu_percent(None)  # it answers for the time since it was last called
        self._cpu, self._date = self._own()[0], time.monotonic()
        self._step = _lines(file)
        if self._step == 0:
            file.write_text(",".join(("step", "time", *NAMES)) + "\n", encoding="utf-8")
            self._step = 1

    def run(self) -> None:
        while not self._over.wait(self._every):
            self._write()

    def end(self) -> None:
        self._over.set()
        self.join()
        self._write()

    def _write(self) -> None:
        memory = psutil.virtual_memory()
        cpu, resident = self._own()
        date = time.monotonic()
        share = 100 * max(0.0, cpu - self._cpu) / max(date - self._date, TICK)
        self._cpu, self._date = cpu, date
        numbers = (
            psutil.cpu_percent(None),
            memory.percent,
            (memory.total - memory.available) / MEGABYTE,
            share,
            resident / MEGABYTE,
        )
        line = ",".join([str(self._step), f"{time.time():.3f}", *(f"{n:.1f}" for n in numbers)])
        with self._file.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        self._step += 1

    def _own(self) -> tuple[float, int]:
        """Return CPU seconds and bytes of memory of this process and those that it started."""
        seconds, resident = 0.0, 0
        for process in (self._process, *self._process.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):  # it has ended just now
                times = process.cpu_times()
                seconds += times.user + times.system
                resident += process.memory_info().rss
        return seconds, resident


def _lines(file: Path) -> int:
    """Return the number of lines of a file, which is the number of the sample that comes next."""
    return len(file.read_text(encoding="utf-8").splitlines()) if file.is_file() else 0
