"""One frozen object is the TOML file, the command line and the flow's parameter."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from mattgs_ops.config import (
    PAPER_CONDITIONS,
    BenchmarkConfig,
    CaptureConfig,
    Condition,
)
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError
from mattgs_ops.method import METHODS


def write(folder: Path, text: str) -> Path:
    path = folder / "benchmark.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_default_is_the_papers_grid_on_the_bundled_captures() -> None:
    config = BenchmarkConfig()
    assert [c.name for c in config.captures] == ["rover", "hexapod", "lattepanda"]
    assert config.conditions == (*PAPER_CONDITIONS, "original-ours+", "nobg-ours+")


def test_it_survives_json_unchanged_as_a_flow_parameter_must() -> None:
    config = BenchmarkConfig(seeds=(0, 1), iterations=7)
    assert BenchmarkConfig.model_validate_json(config.model_dump_json()) == config


def test_it_is_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        BenchmarkConfig().iterations = 3  # type: ignore[misc]


def test_toml_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, '[[captures]]\nname = "mine"\npath = "photos"\n')
    assert load_toml(path).captures == (CaptureConfig(name="mine", path=tmp_path / "photos"),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("iteration = 3", "unknown key `iteration`"),
        ("[sfm]\nmod = 'masked'", "unknown key `sfm.mod`"),
        ("resolution = 2", r"`resolution`.*16, found 2"),
        ("[sfm]\nmode = 'best'", r"`sfm.mode`.*'masked'.*found 'best'"),
        ("conditions = ['nobg']", r"expected BACKGROUND-METHOD"),
        ("conditions = ['nobg-theirs']", r"method 'theirs': expected one of .*3dgs"),
        ("seeds = [0, -1]", r"`seeds.1`: .* greater than or equal to 0, found -1"),
        ("seeds = [1, 1]", r"`seeds`: expected different ones, found 1, 1$"),
        ("captures = []", r"`captures`: expected at least one, found none$"),
        ("conditions = []", r"`conditions`: expected at least one, found none$"),
        ("conditions = ['x']", r"toml: `conditions`: condition 'x': .*, for example `nobg-ours`$"),
        ("conditions = ['nobg-y']", r"toml: `conditions`: method 'y': expected one of [^{]*$"),
        ("[[captures]]\nname = 'toaster'", r"no bundled capture is called 'toaster'.* to photos$"),
        ("name = 'a b'", r"`name`: expected letters, digits .*, found 'a b'"),
        ("name = 'a/../../b'", r"`name`: expected letters, digits .*, found 'a/../../b'"),
        ("[[captures]]\nname = '../x'\npath = 'p'", r"`captures.0.name`.*, found '../x'"),
        ("[methods.'a/../../b']\nweight = 2", r"`methods.a/../../b.*expected letters, digits"),
        ("[methods.'/etc/x']\nweight = 2", r"`methods./etc/x.*, found '/etc/x'"),
        ("iterations = ", r"expected a readable TOML file"),
        ("[train]\nlr_scale = inf", r"`train.lr_scale`: Input should be a finite number"),
        ("[run]\nstage_timeout = nan", r"`run.stage_timeout`: Input should be a finite number"),
        ("[methods.m]\nweight = inf", r"`methods.m.weight`: Input should be a finite number"),
        ("[[captures]]\nname = 'a'\npath = \"a\\u0000b\"", r"`path`: expected a path, found 'a"),
        ("[run]\ndask_scheduler = 'foo'", r"`run.dask_scheduler`: .*\(tcp.tls\)://.*found 'foo'"),
        ("[run]\ndask_certificates = 'keys'", r"dask_certificates: goes with .* tls://HOST:PORT$"),
        (
            "[run]\ndask_certificates = 'keys'\ndask_scheduler = 'tcp://h:1'",
            r"dask_certificates: goes with dask_scheduler tls://HOST:PORT$",
        ),
    ],
)
def test_a_bad_file_is_refused_naming_file_field_and_value(
    tmp_path: Path, text: str, message: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        load_toml(path)
    assert str(path) in str(caught.value)


def test_a_file_of_another_encoding_is_named(tmp_path: Path) -> None:
    path = tmp_path / "benchmark.toml"
    path.write_bytes('name = "rücken"\n'.encode("latin-1"))
    with pytest.raises(
        InputError, match=r"benchmark\.toml: expected a readable TOML file: .*utf-8"
    ):
        load_toml(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml"):
        load_toml(tmp_path / "nowhere.toml")


def test_a_method_of_ones_own_is_a_row_not_a_code_path() -> None:
    config = BenchmarkConfig.model_validate(
        {"methods": {"mine": {"weighting": "residual"}}, "conditions": ["nobg-mine"]}
    )
    assert config.method("mine").weighting == "residual"
    assert config.method("3dgs") == METHODS["3dgs"]


@pytest.mark.parametrize("text", PAPER_CONDITIONS)
def test_a_condition_reads_back_as_it_is_written(text: str) -> None:
    assert str(Condition.parse(text)) == text


def test_photos_have_exposures_of_their_own_in_a_users_captures_only(tmp_path: Path) -> None:
    captures = (CaptureConfig(name="rover"), CaptureConfig(name="mine", path=tmp_path))
    config = BenchmarkConfig(captures=captures)
    assert config.train_settings("rover").exposure == "off"
    assert config.train_settings("mine").exposure == "affine"
    for choice in ("off", "affine"):
        asked = BenchmarkConfig.model_validate(
            {"captures": [c.model_dump() for c in captures], "train": {"exposure": choice}}
        )
        assert {asked.train_settings(n).exposure for n in ("rover", "mine")} == {choice}


TRAINER = """
conditions = ["nobg-3dgs", "nobg-peer"]
[trainers.peer]
command = ["{here}/train.sh", "{data}", "-o", "{output}"]
"""


def test_a_trainer_is_a_method_like_any_other(tmp_path: Path) -> None:
    config = load_toml(write(tmp_path, TRAINER))
    assert config.trainers["peer"].folder == tmp_path.resolve()
    assert config.method_settings("peer")["layout"] == "colmap"
    assert BenchmarkConfig.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize(
    ("before", "after", "what"),
    [
        ("{data}", "{date}", r"unknown placeholder \{date\}: expected one of \{data\}"),
        ("trainers.peer", "trainers.3dgs", "trainers.3dgs: a method has that name"),
        ("command = [", 'version = ["x", "{data}"]\ncommand = [', "not known before a training"),
        ("command = [", 'result = "../a.ply"\ncommand = [', "below {output}"),
        ("command = [", 'result = "{output}/a.ply"\ncommand = [', "{output} already"),
        ("command = [", 'result = "it_{iteration}/a.ply"\ncommand = [', "unknown placeholder"),
        ("command = [", 'result = "a**/a.ply"\ncommand = [', r"\*\* as a whole folder"),
        ("command = [", 'environment = {CAP = "{budgett}"}\ncommand = [', "unknown placeholder"),
        ("command = [", 'progress = "step"\ncommand = [', "a group around the step's number"),
        ("command = [", 'progress = "("\ncommand = [', "not a regular expression"),
        ('command = ["{here}/train.sh", "{data}", "-o", "{output}"]', "command = []", "a program"),
        ("nobg-peer", "nobg-other", "expected one of 3dgs, 3dgs-tuned, mcmc, ours, ours[+], peer"),
    ],
)
def test_a_trainer_that_cannot_work_is_refused_by_name(
    tmp_path: Path, before: str, after: str, what: str
) -> None:
    with pytest.raises(InputError, match=what):
        load_toml(write(tmp_path, TRAINER.replace(before, after)))


def test_budgets_go_to_all_that_can_keep_to_them(tmp_path: Path) -> None:
    text = "budgets = [5000, 10000]\n" + TRAINER
    config = load_toml(write(tmp_path, text))
    assert config.budgets_of("nobg-3dgs") == (5000, 10_000)
    assert config.budgets_of("nobg-peer") == (None,)
    config = load_toml(write(tmp_path, text.replace("-o", "--max={budget}")))
    assert config.budgets_of("nobg-peer") == (5000, 10_000)
    assert config.train_settings("rover", 5000).max_splats == 5000
    with pytest.raises(InputError, match=r"`budgets.0`: .* equal to 100, found 3"):
        load_toml(write(tmp_path, "budgets = [3]\n"))


def test_a_network_and_certificates_lie_beside_the_benchmarks_file(tmp_path: Path) -> None:
    run = '[run]\ndask_certificates = "keys"\ndask_scheduler = "tls://head:8786"\n'
    path = write(tmp_path, f'[segment]\nmodel = "u2net.onnx"\n{run}')
    with pytest.raises(InputError, match=r"`segment\.model`: expected a file of weights at"):
        load_toml(path)
    (tmp_path / "u2net.onnx").touch()
    config = load_toml(path)
    assert config.segment.model == tmp_path / "u2net.onnx"
    assert config.run.dask_certificates == tmp_path / "keys"


def test_weights_of_lpips_lie_beside_the_benchmarks_file_and_are_sought_at_once(
    tmp_path: Path,
) -> None:
    path = tmp_path / "benchmark.toml"
    path.write_text('lpips = "alex.pth"\n')
    with pytest.raises(InputError, match=r"`lpips`: expected a file of weights at .*alex\.pth"):
        load_toml(path)
    (tmp_path / "alex.pth").write_bytes(b"x")
    assert load_toml(path).lpips == tmp_path / "alex.pth"
    assert BenchmarkConfig().lpips is None
