"""Against a server which misbehaves on purpose."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest

import manduca
from manduca import _http

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Answer = Callable[[BaseHTTPRequestHandler], None]


class Fake:
    """Gives its answers one after the other and keeps what it was asked."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.asked: list[tuple[str, dict[str, str]]] = []
        fake = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                fake.asked.append((self.path, {k.lower(): v for k, v in self.headers.items()}))
                fake.answers.pop(0)(self)
                self.close_connection = True

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"


def says(status: int, body: Any, content_type: str = "application/json", **headers: str) -> Answer:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        text = body.encode() if isinstance(body, str) else json.dumps(body).encode()
        handler.send_response(status)
        for name, value in headers.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.send_header("content-type", content_type)
        handler.send_header("content-length", str(len(text)))
        handler.end_headers()
        handler.wfile.write(text)

    return answer


def breaks_off(content_type: str, *chunks: str) -> Answer:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.send_header("content-type", content_type)
        handler.send_header("transfer-encoding", "chunked")
        handler.end_headers()
        for chunk in chunks:
            handler.wfile.write(f"{len(chunk):x}\r\n{chunk}\r\n".encode())

    return answer


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[Fake]:
    monkeypatch.setattr(_http, "_PAUSES_S", (0.0, 0.0))
    fake = Fake()
    thread = threading.Thread(target=fake.server.serve_forever, args=(0.02,))
    thread.start()
    yield fake
    fake.server.shutdown()
    thread.join()
    fake.server.server_close()


def test_the_token_is_sent_and_not_shown(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    fake.answers = [says(200, []), says(200, []), says(200, [])]
    client = manduca.Client(fake.url + "/", token="secret")
    client.workers()
    monkeypatch.setenv("MANDUCA_TOKEN", "from outside")
    monkeypatch.setenv("MANDUCA_COORDINATOR", fake.url)
    manduca.Client().workers()
    monkeypatch.delenv("MANDUCA_TOKEN")
    manduca.Client().workers()
    sent = [headers.get("authorization") for _, headers in fake.asked]
    assert sent == ["Bearer secret", "Bearer from outside", None]
    assert fake.asked[0][0] == "/v1/workers"
    assert "secret" not in repr(client)


def test_redirections_are_not_followed(fake: Fake) -> None:
    fake.answers = [says(302, "", location=f"{fake.url}/elsewhere")]
    with pytest.raises(manduca.ForeignAnswerError, match="elsewhere, which is not followed") as refused:
        manduca.Client(fake.url, token="secret").workers()
    assert refused.value.problem.status == 302
    assert len(fake.asked) == 1


def test_what_passes_is_tried_again(fake: Fake) -> None:
    fake.answers = [says(503, {}, retry_after="0"), says(502, "<html>", "text/html"), says(200, [])]
    assert manduca.Client(fake.url).workers() == []
    assert len(fake.asked) == 3
    fake.answers = [says(503, {"detail": "later"}, "application/problem+json")] * 3
    with pytest.raises(manduca.ProblemError, match="later"):
        manduca.Client(fake.url).workers()


def test_answers_of_others_say_so(fake: Fake) -> None:
    problem = {"type": "urn:manduca:problem:unknown-study", "title": "t", "status": 404, "detail": "d"}
    for answer in (
        says(401, "<html>", "text/html"),
        says(404, "<html>", "text/html"),
        says(404, {"type": "about:blank", "title": "Not Found", "status": 404}, "application/problem+json"),
        says(404, problem, "text/html"),
        says(410, problem, "application/problem+json"),
        says(400, "", "application/json"),
        says(200, "<html>", "text/html"),
        says(200, "", "application/json"),
    ):
        fake.answers = [answer]
        with pytest.raises(manduca.ForeignAnswerError, match="not from a manduca coordinator") as refused:
            manduca.Client(fake.url).workers()
        assert refused.value.problem.type == "about:blank"
        assert refused.value.passing
    fake.answers = [says(404, problem, "application/problem+json")]
    with pytest.raises(manduca.ProblemError, match=r"client\.studies") as definite:
        manduca.Client(fake.url).workers()
    assert not definite.value.passing
    faults = problem | {"type": "urn:manduca:problem:x", "errors": [3, {"pointer": "/a"}]}
    fake.answers = [says(404, faults, "application/problem+json")]
    with pytest.raises(manduca.ProblemError, match="/a"):
        manduca.Client(fake.url).workers()


def test_waiting_outlives_a_restart_and_misses_workers(
    fake: Fake, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs = dict.fromkeys(("ready", "delayed", "leased", "succeeded", "infeasible", "dead", "cancelled"), 0)
    view: dict[str, Any] = {
        "state": "sampling",
        "paused_from": None,
        "progress": None,
        "rate_per_s": None,
        "eta_s": None,
    }
    view |= {"samples": jobs, "stage_jobs": jobs | {"ready": 9}, "spec": {"sampling": {"samples": 9}}}
    away = says(502, "<html>", "text/html")
    fake.answers = [says(200, view), says(200, view), says(200, [])]
    fake.answers += [away] * 6 + [says(200, view | {"state": "succeeded"})]
    manduca.Client(fake.url).study("x").wait(poll_s=0.0)
    said = capsys.readouterr().err.splitlines()
    assert said[:2] == [f"no worker is connected: manduca worker --coordinator {fake.url}", "sampling   0/9"]
    assert len(fake.asked) == 10
    gone = {"type": "urn:manduca:problem:unknown-study", "title": "t", "status": 404, "detail": "d"}
    strangers = [
        says(404, "<html>", "text/html"),
        says(302, "", location="/login"),
        says(200, "", "text/html"),
    ]
    fake.answers = [
        says(200, view),
        says(200, view),
        says(200, []),
        *strangers,
        says(404, gone, "application/problem+json"),
    ]
    with pytest.raises(manduca.ProblemError, match="unknown-study"):
        manduca.Client(fake.url).study("x").wait(poll_s=0.0)


HEADER = "sample,outcome,reason,solver_version\r\n"


@pytest.mark.parametrize(
    ("take", "of"), [("dataset", "text/csv"), ("dataset_arrow", "application/vnd.apache.parquet")]
)
def test_a_table_which_breaks_off_is_no_table(fake: Fake, take: str, of: str) -> None:
    fake.answers = [says(200, {"id": "x"}), breaks_off(of, HEADER, "0,ok,,4\r\n")]
    study = manduca.Client(fake.url).study("x")
    with pytest.raises(manduca.UnreachableError, match="broke off"):
        getattr(study, take)()


def test_rows_which_break_off_say_so(fake: Fake) -> None:
    fake.answers = [says(200, {"id": "x"}), breaks_off("application/x-ndjson", '{"sample": 0}\n{"sam')]
    rows = manduca.Client(fake.url).study("x").rows()
    with pytest.raises(manduca.UnreachableError, match="broke off"):
        list(rows)


def test_a_table_with_fewer_rows_than_announced_is_no_table(fake: Fake) -> None:
    fake.answers = [says(200, {"id": "x"}), says(200, HEADER + "0,ok,,4\r\n", "text/csv", manduca_rows="2")]
    with pytest.raises(manduca.UnreachableError, match="1 of 2 rows"):
        manduca.Client(fake.url).study("x").dataset()
    line = '{"sample": 0}\n'
    fake.answers = [
        says(200, {"id": "x"}),
        says(200, line + '{"sam', "application/x-ndjson", manduca_rows="2"),
    ]
    with pytest.raises(manduca.UnreachableError, match="1 of 2 rows"):
        list(manduca.Client(fake.url).study("x").rows())
    fake.answers = [says(200, {"id": "x"}), says(200, "<html>", "text/html")]
    with pytest.raises(manduca.ForeignAnswerError, match="text/html in place of text/csv"):
        manduca.Client(fake.url).study("x").dataset()


def test_a_stroke_which_cannot_be_flown_has_no_means(fake: Fake) -> None:
    text = 'sample,outcome,lift_n,reason,solver_version\r\n0,ok,0.1,,4\r\n1,infeasible,,"no lift, none",4\r\n'
    fake.answers = [says(200, {"id": "x"}), says(200, text, "text/csv")]
    frame = manduca.Client(fake.url).study("x").dataset()
    assert frame.lift_n.isna().tolist() == [False, True]
    assert frame.reason.tolist() == ["", "no lift, none"]
    assert frame.solver_version.tolist() == ["4", "4"]


def test_nobody_there(fake: Fake) -> None:
    fake.server.server_close()
    with pytest.raises(manduca.UnreachableError, match="manduca serve"):
        manduca.Client(fake.url).workers()


@pytest.mark.parametrize("url", ["localhost:8080", "127.0.0.1", "file:///etc/passwd", "http://"])
def test_addresses_are_checked(url: str) -> None:
    with pytest.raises(ValueError, match="address of a coordinator"):
        manduca.Client(url)
