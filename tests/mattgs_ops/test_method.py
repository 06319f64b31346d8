"""The built-in methods, and methods of one's own that start from them."""

from pathlib import Path

import pytest

from mattgs_ops.config import BenchmarkConfig, Condition
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError
from mattgs_ops.method import METHODS, MethodConfig

BENCHMARKS = sorted((Path(__file__).parents[2] / "benchmarks").glob("*.toml"))
(ABLATION,) = (path for path in BENCHMARKS if path.stem == "ablation")


def test_plain_3dgs_switches_nothing_of_ours_on() -> None:
    assert METHODS["3dgs"] == MethodConfig()
    plain = METHODS["3dgs"]
    assert (plain.weighting, plain.prune, plain.prune_initial) == ("none", "none", False)


def test_the_control_has_all_of_ours_plus_that_is_neither_mask_nor_attention() -> None:
    best, control = METHODS["ours+"], METHODS["3dgs-tuned"]
    differing = {n for n in MethodConfig.model_fields if getattr(best, n) != getattr(control, n)}
    assert differing == {
        *("attention", "weighting", "weight", "mask_weight", "weight_ssim"),
        *("edge_tolerance", "alpha_loss", "prune", "prune_opacity"),
    }
    plain = METHODS["3dgs"]
    assert all(getattr(control, name) == getattr(plain, name) for name in differing)
    assert (control.weighting, control.prune) == ("none", "none")
    assert MethodConfig.model_validate(best.model_dump()) == best


def test_the_threshold_of_splats_without_a_background_is_the_same_unless_it_is_said() -> None:
    same = MethodConfig(densify_absolute=2e-3)
    other = MethodConfig(densify_absolute=2e-3, densify_absolute_nobg=3e-3)
    assert [same.absolute_threshold(b) for b in ("original", "nobg")] == [2e-3, 2e-3]
    assert [other.absolute_threshold(b) for b in ("original", "nobg")] == [2e-3, 3e-3]


def test_rates_fall_with_the_steps_beyond_those_they_are_meant_for() -> None:
    short = MethodConfig(rates=2.0, rates_steps=7000)
    found = [short.rates_in(steps) for steps in (100, 7000, 14_000, 30_000)]
    assert found == pytest.approx([2.0, 2.0, 1.0, 14 / 30])
    assert MethodConfig(rates=2.0).rates_in(30_000) == 2.0


def test_a_method_like_another_differs_in_what_its_table_says() -> None:
    tables = {"mine": {"like": "ours+", "prune": "none"}, "plain": {"weight": 3.0}}
    config = BenchmarkConfig.model_validate({"methods": tables})
    assert config.method("mine") == METHODS["ours+"].model_copy(update={"prune": "none"})
    assert config.method("plain") == MethodConfig(weight=3.0)


def test_what_is_no_name_is_no_method(tmp_path: Path) -> None:
    path = tmp_path / "b.toml"
    path.write_text('[methods.mine]\nlike = ["ours"]\n')
    with pytest.raises(InputError, match=r"methods.*like = \['ours'\]: expected one of 3dgs"):
        load_toml(path)


def test_a_method_like_an_unknown_one_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "benchmark.toml"
    path.write_text('[methods.mine]\nlike = "mine-too"\n')
    with pytest.raises(
        InputError,
        match=r"methods.*like = 'mine-too': expected one of 3dgs, 3dgs-tuned, mcmc, ours",
    ):
        load_toml(path)


def test_the_ablation_leaves_out_and_adds_one_part_at_a_time() -> None:
    config = load_toml(ABLATION)
    plain, best = METHODS["3dgs"], METHODS["ours+"]
    parts = {condition.removeprefix("nobg-") for condition in config.conditions}
    added = {name for name in parts if name.startswith("only-")}
    left_out = {name for name in parts if name.startswith("no-")}
    assert parts == added | left_out | {"3dgs", "3dgs-tuned", "ours+"}
    for name in parts:
        for field in MethodConfig.model_fields:
            value = getattr(config.method(name), field)
            assert value in (getattr(plain, field), getattr(best, field), 0.0, 8e-4), (name, field)
    assert all(config.method(name) != plain for name in added)
    assert all(config.method(name) != best for name in left_out)


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: str(path.stem))
def test_every_benchmark_file_names_conditions_that_can_be_trained(path: Path) -> None:
    config = load_toml(path)
    assert config.name == path.stem
    for condition in config.conditions:
        method = Condition.parse(condition).method
        assert method in config.trainers or config.method(method)
