"""The base of all configuration, and a word that several of its modules need."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

Background = Literal["original", "nobg"]


class Frozen(BaseModel):
    """Base of all configuration: immutable, and no key that it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())
