"""Options and files become one configuration; what cannot be meant is refused by name."""

from pathlib import Path
from typing import Any

import pytest

from flows.cli.options import benchmark_config, numbers, size, words
from mattgs_ops.errors import InputError
from mattgs_ops.naming import capture_name


def test_without_options_the_bundled_captures_run_under_all_conditions_the_papers_first() -> None:
    config = benchmark_config(None, {"name": None, "iterations": None})
    assert [c.name for c in config.captures] == ["rover", "hexapod", "lattepanda"]
    paper = ("original-3dgs", "original-ours", "nobg-3dgs", "nobg-ours")
    assert config.conditions == (*paper, "original-ours+", "nobg-ours+")


def test_options_override_the_file(tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    file.write_text('name = "mine"\niterations = 7\nresolution = 64\n[run]\nthreads = 2\n')
    config = benchmark_config(file, {"iterations": 9, "workers": 3})
    assert (config.name, config.iterations, config.resolution) == ("mine", 9, 64)
    assert (config.run.threads, config.run.workers) == (2, 3)


@pytest.mark.parametrize(
    ("folder", "name"), [("my cat", "my-cat"), ("cat/images", "cat"), ("Ünïcode", "n-code")]
)
def test_photos_name_capture_and_benchmark_after_their_folder(
    tmp_path: Path, folder: str, name: str
) -> None:
    config = benchmark_config(None, {"photos": tmp_path / folder})
    assert config.name == name
    (capture,) = config.captures
    assert (capture.name, capture.kind, capture.path) == (name, "photos", tmp_path / folder)


@pytest.mark.parametrize("file", ["transforms.json", "transforms_train.json"])
def test_a_file_of_cameras_stands_for_its_folder(tmp_path: Path, file: str) -> None:
    (tmp_path / "cat").mkdir()
    (tmp_path / "cat" / file).write_text("{}")
    config = benchmark_config(None, {"capture": tmp_path / "cat" / file})
    assert (config.name, config.captures[0].path) == ("cat", tmp_path / "cat")


def test_a_name_is_the_captures_and_the_benchmarks(tmp_path: Path) -> None:
    options = {"capture": tmp_path / "x", "name": "toy", "masks": tmp_path / "m"}
    config = benchmark_config(None, options)
    assert (config.name, config.captures[0].name) == ("toy", "toy")
    assert (config.captures[0].kind, config.captures[0].masks) == ("auto", tmp_path / "m")


def test_a_video_names_capture_and_benchmark_after_itself(tmp_path: Path) -> None:
    (tmp_path / "my walk.mp4").write_bytes(b"")
    config = benchmark_config(None, {"video": tmp_path / "my walk.mp4", "frames": 40})
    (capture,) = config.captures
    assert (config.name, capture.name, capture.kind, capture.frames) == (
        "my-walk",
        "my-walk",
        "video",
        40,
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"captures": ("robot",)}, "--captures.*'robot'.*rover, hexapod, lattepanda"),
        ({"photos": Path("a"), "capture": Path("b")}, "--photos and --capture"),
        ({"photos": Path("a"), "video": Path("b")}, "--photos and --video"),
        ({"photos": Path("a"), "frames": 9}, "--frames: goes with --video"),
        ({"video": Path("a"), "frames": 2}, "`captures.0.frames`.*found 2"),
        ({"masks": Path("m")}, "--masks: goes with --photos"),
        ({"captures": ("rover",), "masks": Path("m")}, "not with bundled"),
        ({"iterations": 0}, "`iterations`.*found 0"),
        ({"conditions": ("nobg-mine",)}, "'mine': expected one of 3dgs, 3dgs-tuned, mcmc, ours"),
        ({"conditions": ("white-3dgs",)}, "^command line: `conditions`: .*BACKGROUND-METHOD"),
        (
            {"conditions": words("")},
            "^command line: `conditions`: expected at least one, found none$",
        ),
        ({"dask_scheduler": "foo"}, "`run.dask_scheduler`: .*, found 'foo'"),
        ({"dask_certificates": Path("keys")}, "dask_certificates: goes with .*tls://HOST:PORT$"),
        ({"seeds": (1, 1)}, "`seeds`: expected different ones"),
        ({"name": "a b"}, "`name`"),
        ({"name": "a/../../b"}, "`name`: expected letters, digits .*, found 'a/../../b'"),
        ({"photos": Path("p"), "name": "/etc/x"}, "`captures.0.name`.*, found '/etc/x'"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_name(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        benchmark_config(None, options)


def test_lists_are_split_at_commas_and_blanks() -> None:
    assert words("a,b c, d") == ("a", "b", "c", "d")
    assert words(None) is None
    assert words("") == words(" , ") == ()
    assert numbers("0, 1 2", "--seeds") == (0, 1, 2)
    assert size("640x480", "--resolution") == (640, 480)
    with pytest.raises(InputError, match=r"--seeds.*'1,x'"):
        numbers("1,x", "--seeds")
    with pytest.raises(InputError, match=r"--resolution.*'640'"):
        size("640", "--resolution")


def test_any_folder_name_becomes_a_valid_name() -> None:
    assert capture_name("  my (best) cat! ") == "my-best-cat"
    assert capture_name("???") == "capture"
