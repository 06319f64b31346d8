"""The base of all configuration, and what several of its modules need."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Background = Literal["original", "nobg"]
Seed = Annotated[int, Field(ge=0)]  # numpy's generators take no other


class Frozen(BaseModel):
    """Base of all configuration: immutable, no key that it does not know, numbers finite."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, protected_namespaces=()
    )
