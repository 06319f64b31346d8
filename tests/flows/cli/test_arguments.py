"""What commands say for errors of services."""

import pytest
from mlflow.exceptions import MlflowException

from flows.cli.arguments import of_mlflow


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("the server is gone\nat line 3", "MLflow: the server is gone"),
        ("\n the server is gone", "MLflow: the server is gone"),
        ("", "MLflow: MlflowException"),
    ],
)
def test_what_mlflow_says_is_one_line(message: str, told: str) -> None:
    assert of_mlflow(MlflowException(message)) == told


def test_errors_of_others_are_not_mlflows() -> None:
    assert of_mlflow(ValueError("no")) is None
