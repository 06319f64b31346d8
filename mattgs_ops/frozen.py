"""The base of all configuration, and a word that several of its modules need."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

Background = Literal["original", "nobg"]


class Frozen(BaseModel):
    """Base of all configuration: immutable, no key that it does not know, numbers finite."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, protected_namespaces=()
    )
