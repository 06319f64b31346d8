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

from typing_extensions import override

from mattgs_ops.errors import InputError

HOME = Path(".prefect")  # below the user's home, Prefect's default
PEM_BEGIN, PEM_END = "-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----"


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
def using(api: str) -> Iterator[None]:
    """Use the API of this address in this process."""
    from prefect.settings import PREFECT_API_URL, temporary_settings

    with temporary_settings({PREFECT_API_URL: api}):
        yield


@contextmanager
def using_own(api: str, certificates: Path) -> Iterator[None]:
    """Use our own server in this process, with :func:`certificates_for_own`; runs send it no logs.

    Nobody looks at a temporary server: the log files have it all.
    """
    from prefect import settings

    updates: dict[Any, Any] = {
        settings.PREFECT_API_URL: api,
        settings.PREFECT_API_SSL_CERT_FILE: str(certificates),
        settings.PREFECT_LOGGING_TO_API_ENABLED: False,
    }
    with settings.temporary_settings(updates), _handed_on_whole():
        yield


@contextmanager
def _handed_on_whole() -> Iterator[None]:
    """Hand this process's settings to task runs as one object.

    Prefect writes them out for each task run, and the worker makes them anew from that and all that
    it finds in its own surroundings: 0.3 CPU seconds a run. Workers of our own have the same ones.
    """
    from prefect.context import SettingsContext, get_settings_context

    class Whole(SettingsContext):
        @override
        def serialize(self, include_secrets: bool = True) -> dict[str, Any]:
            if not include_secrets:
                return super().serialize(include_secrets=False)
            return {"profile": self.profile, "settings": self.settings}

    found = get_settings_context()
    with Whole(profile=found.profile, settings=found.settings):
        yield


def certificates_for_own(folder: Path) -> Path:
    """Write the first of the usual authorities' certificates into ``folder``; return its path.

    Our own server speaks plain HTTP, and nothing is ever checked by it. But Prefect's client reads
    its file of authorities for each connection, several times in a task run: 80 CPU milliseconds
    with all of the usual ones, 2 with one.
    """
    import certifi

    text = Path(certifi.where()).read_text(encoding="utf-8")
    begin = text.index(PEM_BEGIN)
    path = folder / "one-authority.pem"
    path.write_text(text[begin : text.index(PEM_END, begin)] + PEM_END + "\n", encoding="utf-8")
    return path


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
