"""The process that loads COLMAP: ``python -m mattgs_ops.sfm.colmap.worker JOB.json``.

Standard output carries one JSON object per line, ``{"done", "total", "note"}``; standard error is
COLMAP's log. An error of ours ends it with status 3 and ``{"error", "kind"}`` as the last line.
Everything else, a crash inside COLMAP included, is for the parent to report.
"""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mattgs_ops.child_process import die_with_parent
from mattgs_ops.errors import MattgsError
from mattgs_ops.sfm.colmap.job import Job

OUR_ERROR = 3  # exit status of a failure that has a message of its own


def main(arguments: Sequence[str]) -> int:
    """Run the job named by the one argument; returns the exit status."""
    die_with_parent(os.getppid())
    from mattgs_ops.sfm.colmap.attempts import run

    job = Job.load(Path(arguments[0]))
    try:
        run(job, _report_progress).save(Path(job.workspace))
    except MattgsError as error:
        _print_message({"error": str(error), "kind": type(error).__name__})
        return OUR_ERROR
    return 0


def _report_progress(done: int, total: int, note: str) -> None:
    _print_message({"done": done, "total": total, "note": note})


def _print_message(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # COLMAP's static objects have crashed while Python shuts down; all files are closed by now
    os._exit(status)
