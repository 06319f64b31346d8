"""The key of a stage: what determines its result, and the digest of that, its address."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from mattgs_ops.errors import InputError
from mattgs_ops.store.digests import json_digest

DIGEST_LETTERS = 32  # 128 bits name a folder


@dataclass(frozen=True)
class StageKey:
    """What determines a stage's result; as text its place in the store, ``STAGE/DIGEST``."""

    stage: str
    code_version: str
    params: Mapping[str, Any]
    inputs: Mapping[str, str]

    @property
    def digest(self) -> str:
        """Name of the artifact's folder."""
        return json_digest(self.parts())[:DIGEST_LETTERS]

    def parts(self) -> dict[str, Any]:
        """Return what the digest is made of, as JSON values."""
        return {
            "stage": self.stage,
            "code_version": self.code_version,
            "params": dict(self.params),
            "inputs": dict(self.inputs),
        }

    def __str__(self) -> str:
        return f"{self.stage}/{self.digest}"


def stage_key(
    stage: str, code_version: str, params: BaseModel | Mapping[str, Any], inputs: Mapping[str, str]
) -> StageKey:
    """Make a key; ``inputs`` maps names to digests of contents.

    Raises TypeError for parameters that JSON cannot hold: a path is no parameter, the digest of
    what lies there is an input.
    """
    if not stage or not stage.replace("-", "").replace("_", "").isalnum():
        raise InputError(f"stage {stage!r}: expected letters, digits, - and _")
    values = params.model_dump(mode="json") if isinstance(params, BaseModel) else dict(params)
    key = StageKey(stage, code_version, values, dict(inputs))
    json_digest(key.parts())  # refuses now what it would refuse later
    return key
