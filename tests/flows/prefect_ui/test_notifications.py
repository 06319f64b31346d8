"""Messages of failed runs: real runs on a real server, blocks that it keeps, SMTP on loopback."""

import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from prefect import flow
from prefect.blocks.notifications import SlackWebhook
from prefect.blocks.system import Secret
from prefect.settings import PREFECT_API_URL, PREFECT_LOGGING_TO_API_ENABLED, temporary_settings
from pydantic import SecretStr, ValidationError

from flows.prefect_ui import notifications
from mattgs_ops.config import RunConfig
from mattgs_ops.errors import InputError

# Apprise, which sends for Prefect's blocks, looks for this module when it loads its mail plugin
pytestmark = pytest.mark.filterwarnings("ignore:'imghdr' is deprecated:DeprecationWarning")


@pytest.fixture(autouse=True)
def server(prefect_api: str) -> Iterator[None]:
    with temporary_settings({PREFECT_API_URL: prefect_api, PREFECT_LOGGING_TO_API_ENABLED: False}):
        yield


@contextmanager
def mail_server() -> Iterator[tuple[str, list[str]]]:
    """Take mail as SMTP has it, without encryption; yield the address, and what was sent."""
    mails: list[str] = []

    class Takes(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            self.wfile.write(b"220 here\r\n")
            for line in self.rfile:
                word = line.split()[0].upper()
                if word == b"DATA":
                    self.wfile.write(b"354 go on\r\n")
                    lines = iter(self.rfile.readline, b".\r\n")
                    mails.append(b"".join(lines).decode())
                self.wfile.write(b"250 good\r\n")
                if word == b"QUIT":
                    return

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Takes) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_address[1]}", mails
        server.shutdown()


def test_a_block_whose_address_is_a_mail_box_sends_one_mail_for_nested_runs() -> None:
    with mail_server() as (address, mails):
        url = SecretStr(f"mailto://{address}?from=bench@lab.org&to=me@lab.org&mode=insecure")
        SlackWebhook(url=url).save("lab-mail")
        notifications.check("slack-webhook/lab-mail")
        hooks = notifications.failure_hook("slack-webhook/lab-mail")

        @flow(name="inner", on_failure=hooks)
        def inner() -> None:
            raise RuntimeError("2 of 3 experiments failed")

        @flow(name="outer", flow_run_name="night", on_failure=hooks)
        def outer() -> None:
            inner()

        with pytest.raises(RuntimeError):
            outer()
    (mail,) = mails
    assert "To: me@lab.org" in mail
    assert "outer night: Failed" in mail
    assert "2 of 3 experiments failed" in mail


def test_a_forms_target_gets_the_message_of_its_run() -> None:
    with mail_server() as (address, mails):
        url = SecretStr(f"mailto://{address}?from=bench@lab.org&to=me@lab.org&mode=insecure")
        SlackWebhook(url=url).save("lab-form")

        @flow(name="grid", on_failure=[notifications.parameters_hook])
        def grid(settings: dict[str, str]) -> None:
            raise RuntimeError(settings["name"])

        with pytest.raises(RuntimeError):
            grid({"name": "weekly", "notify": "slack-webhook/lab-form"})
    assert len(mails) == 1


def test_a_block_that_is_not_there_or_sends_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="has no block 'slack-webhook/nobody'"):
        notifications.check("slack-webhook/nobody")
    Secret(value=SecretStr("x")).save("not-a-message")
    with pytest.raises(InputError, match="expected a notification block, found"):
        notifications.check("secret/not-a-message")


def test_an_address_that_does_not_answer_costs_a_warning_without_its_secret(
    caplog: pytest.LogCaptureFixture,
) -> None:
    @flow(name="alone", on_failure=notifications.failure_hook("http://127.0.0.1:9/secret"))
    def alone() -> None:
        raise RuntimeError("as expected")

    with pytest.raises(RuntimeError, match="as expected"):
        alone()
    assert "no message was sent to http://127.0.0.1:9: " in caplog.text
    assert "secret" not in caplog.text


@pytest.mark.parametrize("target", ["me@lab.org", "slack-webhook", "ftp://lab.org/x"])
def test_a_target_that_is_neither_block_nor_address_is_refused(target: str) -> None:
    with pytest.raises(ValidationError, match="notify"):
        RunConfig(notify=target)
