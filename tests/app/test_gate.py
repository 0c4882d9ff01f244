"""Who may ask: this machine, with the secret, from the app's own page; and for what."""

from __future__ import annotations

import http.client
from collections.abc import Iterator

import pytest

from app.conftest import App, start_app


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    """Return one app for these tests."""
    one = start_app(tmp_path_factory.mktemp("gate") / "project", "--max-upload", "1")
    yield one
    one.kill()


def ask(port: int, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def test_who_and_what_is_refused(running: App) -> None:
    port, own = running.port, f"/{running.token}"
    assert len(running.token) >= 32
    status, headers, page = ask(port, f"{own}/")
    assert status == 200
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert b"http://" not in page.replace(f"http://127.0.0.1:{port}".encode(), b"").replace(
        b"http://www.w3.org", b""
    )

    # without the secret, or with another: pages, scripts, websockets, files, uploads
    wrong = f"/{'A' * len(running.token)}"
    places = (
        "/",
        "",
        "/ws",
        "/static/js/bokeh.min.js",
        "/autoload.js",
        "/files/app.toml",
        "/upload",
        "/favicon.ico",
    )
    for place in places:
        for start in ("", wrong, f"{own[:-1]}", f"/x{own}"):
            assert ask(port, f"{start}{place}")[0] == 403, (start, place)
    assert ask(port, f"{wrong}/upload?name=x", "POST")[0] == 403
    assert ask(port, "*", "OPTIONS")[0] == 403

    # from another origin, and by another name of this machine
    for origin in (
        "http://evil.example",
        f"http://127.0.0.1:{port + 1}",
        "null",
        f"https://127.0.0.1:{port}",
    ):
        assert ask(port, f"{own}/", Origin=origin)[0] == 403, origin
        assert ask(port, f"{own}/upload?name=x", "POST", Origin=origin)[0] == 403, origin
    assert ask(port, f"{own}/", Host=f"evil.example:{port}")[0] == 403
    assert ask(port, f"{own}/", Origin=f"http://127.0.0.1:{port}")[0] == 200

    # files of the folder only
    (running.folder / "a.html").write_text("<script>1</script>")
    (running.folder / "a.svg").write_text("<svg/>")
    (running.folder.parent / "secret.txt").write_text("secret")
    (running.folder / "link.txt").symlink_to(running.folder.parent / "secret.txt")
    status, headers, _ = ask(port, f"{own}/files/a.html")
    assert status == 200
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts")
    assert ask(port, f"{own}/files/a.svg")[1]["Content-Disposition"] == "attachment"
    for place in (
        "../secret.txt",
        "..%2fsecret.txt",
        "%2e%2e/secret.txt",
        "/etc/passwd",
        "link.txt",
        "",
        "logs/../../secret.txt",
    ):
        status, _, body = ask(port, f"{own}/files/{place}")
        assert status in (400, 403, 404), place
        assert body != b"secret"


def test_a_websocket_of_another_page_is_refused(running: App) -> None:
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAA",
    }
    own, page = f"/{running.token}", f"http://127.0.0.1:{running.port}"
    assert ask(running.port, f"{own}/ws", Origin="http://evil.example", **upgrade)[0] == 403
    assert ask(running.port, "/ws", Origin=page, **upgrade)[0] == 403


def test_an_upload_stays_in_the_folder(running: App) -> None:
    before = set(running.folder.parent.rglob("*"))
    for name in ("../../x.ulg", "/etc/x.ulg", "..", ".hidden", "a%00b", "con\\x.ulg"):
        connection = http.client.HTTPConnection("127.0.0.1", running.port)
        connection.request("POST", f"/{running.token}/upload?name={name}&into=../..", body=b"abc")
        answer = connection.getresponse()
        assert answer.status == 200, (name, answer.read())
        connection.close()
    kept = set(running.folder.parent.rglob("*")) - before
    assert all(p.is_relative_to(running.folder / "logs") for p in kept)
    assert not any(p.name.startswith(".") for p in kept)


def test_another_log_of_the_same_name_replaces_none(running: App) -> None:
    def sent(query: str, body: bytes) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", running.port)
        connection.request("POST", f"/{running.token}/upload?{query}", body=body)
        answer = connection.getresponse()
        found = answer.status, answer.read().decode()
        connection.close()
        return found

    assert [sent("name=same.ulg", body)[1] for body in (b"one", b"one", b"two")] == [
        "logs/same.ulg", "logs/same.ulg", "logs/1-same.ulg",
    ]  # fmt: skip
    assert (running.folder / "logs" / "same.ulg").read_bytes() == b"one"
    assert sent("name=t.csv&into=tables", b"one") == (200, "logs/tables")
    status, why = sent("name=t.csv&into=tables", b"two")
    assert (status, "rename the folder" in why) == (409, True)


def test_a_log_of_two_gigabytes_is_refused_before_it_is_sent(running: App) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", running.port)
    connection.putrequest("POST", f"/{running.token}/upload?name=large.ulg")
    connection.putheader("Content-Length", str(2 * 10**9))
    connection.endheaders()
    answer = connection.getresponse()
    assert (answer.status, answer.read()[:24]) == (413, b"the log holds 2 GB, more")
    connection.close()
    # a browser asks before it sends
    own = f"/{running.token}/upload?size="
    assert ask(running.port, f"{own}{2 * 10**9}")[0] == 413
    assert ask(running.port, f"{own}1000")[0] == 200
    assert not list(running.folder.rglob("large*"))
