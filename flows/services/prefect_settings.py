"""Which Prefect API is used, as Prefect itself resolves it.

Prefect reads, in this order: variables, ``.env`` and ``prefect.toml`` or ``pyproject.toml`` in the
current folder, and the active profile (``prefect profile use``, ``prefect cloud login``). A server
of our own is started only where none of these names an API.
"""

import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mattgs_ops.errors import InputError

HOME = Path(".prefect")  # below the user's home, Prefect's default


def configured() -> bool:
    """Whether the user has configured Prefect, in whatever way; imports nothing."""
    if any(key in os.environ for key in ("PREFECT_HOME", "PREFECT_PROFILES_PATH")):
        return True
    with suppress(OSError, RuntimeError):  # no home, or one that is not ours to read
        if (Path.home() / HOME / "profiles.toml").is_file():
            return True
    if Path("prefect.toml").is_file():
        return True
    with suppress(OSError, tomllib.TOMLDecodeError, UnicodeDecodeError):
        if "prefect" in tomllib.loads(Path("pyproject.toml").read_text("utf-8")).get("tool", {}):
            return True
    with suppress(OSError, UnicodeDecodeError):
        return "PREFECT_" in Path(".env").read_text(encoding="utf-8")
    return False


def use_own_home(out: Path) -> None:
    """Keep Prefect's files below ``out`` unless the user has configured Prefect.

    Call before Prefect is imported.
    """
    if not configured():
        home = out / "prefect" / "client"
        home.mkdir(parents=True, exist_ok=True)  # Prefect warns where its parent is missing
        os.environ["PREFECT_HOME"] = str(home)


def api_url() -> str | None:
    """Return the API's address, None where none is configured."""
    from prefect.settings import PREFECT_API_URL

    # a variable that was set after Prefect was imported counts too
    return os.environ.get("PREFECT_API_URL") or PREFECT_API_URL.value()


@contextmanager
def using(api: str, *, logs: bool = True) -> Iterator[None]:
    """Use the API of this address in this process; without ``logs`` runs send it none."""
    from prefect.settings import PREFECT_API_URL, PREFECT_LOGGING_TO_API_ENABLED, temporary_settings

    updates: dict[Any, Any] = {PREFECT_API_URL: api}
    if not logs:
        updates[PREFECT_LOGGING_TO_API_ENABLED] = False
    with temporary_settings(updates):
        yield


def check(api: str) -> None:
    """Raise :class:`InputError` where the API of this address cannot be used.

    Found out later it would be a hundred lines of Prefect's client, once photos were prepared.
    """
    from prefect.client.orchestration import get_client

    parts = urlsplit(api)
    shown = parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()  # without a password
    with using(api), get_client(sync_client=True) as client:
        failed = client.api_healthcheck()
        if failed is None:
            try:
                client.raise_for_api_version_mismatch()
            except Exception as error:  # a RuntimeError, or the HTTP library's
                failed = error
    if failed is not None:
        raise InputError(f"Prefect at {shown} cannot be used: {failed}") from failed
