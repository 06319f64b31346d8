"""``mattgs run`` before its flow: what it plans, and what it tells of captures."""

from pathlib import Path
from threading import Barrier

import pytest

from flows import run_record
from flows.cli import run
from flows.services import embedded
from mattgs_ops.config import BenchmarkConfig, CaptureConfig, RunConfig
from mattgs_ops.errors import InputError
from mattgs_ops.naming import slug
from tasks.prepare import prepare
from tasks.stages.stage import Place
from tasks.stages.status import StatusFile, read_all


def test_a_capture_that_is_not_there_is_told_before_the_others_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fails while its files are read, before its stage begins."""

    def prepared(place: Place, capture: CaptureConfig, config: BenchmarkConfig) -> None:
        if capture.name == "lost":
            prepare(place, capture, config)

    monkeypatch.setattr(run, "prepare", prepared)
    lost = CaptureConfig(name="lost", path=tmp_path / "nowhere")
    config = BenchmarkConfig(captures=(CaptureConfig(name="rover"), lost))
    place = Place(tmp_path / "out", "b")
    run._plan(place, config)
    run._prepare_all(place, config)
    (told,) = [one for one in read_all(place.status) if one.state == "failed"]
    assert told.title == "prepare lost"
    assert str(tmp_path / "nowhere") in told.note
    with pytest.raises(InputError, match="nowhere"):
        run._prepare_all(place, config.model_copy(update={"captures": (lost,)}))


def test_captures_are_prepared_as_many_at_a_time_as_there_are_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    together = Barrier(2, timeout=60)  # passes when two wait at it
    done = []

    def prepared(_: Place, capture: CaptureConfig, __: BenchmarkConfig) -> None:
        together.wait()
        done.append(capture.name)

    monkeypatch.setattr(run, "prepare", prepared)
    names = ("a", "b", "c", "d")
    config = BenchmarkConfig(
        captures=tuple(CaptureConfig(name=name, path=tmp_path) for name in names),
        run=RunConfig(workers=2),
    )
    run._prepare_all(Place(tmp_path / "out", "b"), config)
    assert sorted(done) == list(names)


def test_a_smaller_grid_of_the_same_name_leaves_no_stage_of_the_larger(tmp_path: Path) -> None:
    place = Place(tmp_path / "out", "b")
    large, small = (
        BenchmarkConfig(captures=(CaptureConfig(name="rover"),), seeds=seeds)
        for seeds in ((0, 1), (1,))
    )
    assert run._plan(place, large) == len(read_all(place.status))
    assert run._plan(place, small) == len(read_all(place.status))
    assert not [one for one in read_all(place.status) if "seed 0" in one.title]


def test_beside_another_run_of_the_name_its_stages_stay_and_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place = Place(tmp_path, "b")
    grids = [
        BenchmarkConfig(name="b", captures=(CaptureConfig(name="rover"),), seeds=seeds)
        for seeds in ((0, 1), (1,))
    ]
    count = run._plan(place, grids[0])
    titles = ("train rover nobg-3dgs seed 1", "evaluate rover nobg-3dgs seed 1")
    for title, state in zip(titles, ("running", "done"), strict=True):
        file = StatusFile(place.status / f"{slug(title)}.json")
        file.begin(title, title.split(maxsplit=1)[0])
        if state == "done":
            file.end("done")
    counts = []
    planned = run._plan

    def plan(place: Place, config: BenchmarkConfig, *, alone: bool = True) -> int:
        counts.append(planned(place, config, alone=alone))
        raise InputError("no further")

    monkeypatch.setattr(run, "_plan", plan)
    monkeypatch.setattr(embedded, "enter", lambda _: None)
    record = run_record.RunRecord("new", "running", "", beside=((4711, "here"),))
    with pytest.raises(InputError, match="no further"):
        run._run(grids[1], tmp_path, 1, record)
    states = {one.title: one.state for one in read_all(place.status)}
    assert counts == [count] == [len(states)]
    assert [states[title] for title in titles] == ["running", "done"]
    told = capsys.readouterr().out
    assert told.startswith(f"! another run of b is at work in {tmp_path} (process 4711); ")
    with pytest.raises(InputError, match="no further"):
        run._run(grids[1], tmp_path, 1, run_record.RunRecord("alone", "running", ""))
    assert capsys.readouterr().out == ""
    assert counts[1] == len(read_all(place.status)) < count
