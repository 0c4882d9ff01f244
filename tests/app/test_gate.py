"""Who may ask: this machine, with the secret, from the app's own page; and for what."""

from __future__ import annotations

import http.client
from pathlib import Path


def ask(port: int, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def test_who_and_what_is_refused(app, tmp_path: Path) -> None:
    running = app()
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
    (tmp_path / "secret.txt").write_text("secret")
    (running.folder / "link.txt").symlink_to(tmp_path / "secret.txt")
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
        assert status in (403, 404), place
        assert body != b"secret"


def test_a_websocket_of_another_page_is_refused(app) -> None:
    running = app()
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAA",
    }
    own, page = f"/{running.token}", f"http://127.0.0.1:{running.port}"
    assert ask(running.port, f"{own}/ws", Origin="http://evil.example", **upgrade)[0] == 403
    assert ask(running.port, "/ws", Origin=page, **upgrade)[0] == 403


def test_an_upload_stays_in_the_folder(app) -> None:
    running = app()
    for name in ("../../x.ulg", "/etc/x.ulg", "..", ".hidden", "a%00b", "con\\x.ulg"):
        connection = http.client.HTTPConnection("127.0.0.1", running.port, timeout=20)
        connection.request("POST", f"/{running.token}/upload?name={name}&into=../..", body=b"abc")
        answer = connection.getresponse()
        assert answer.status == 200, (name, answer.read())
        connection.close()
    kept = [p.relative_to(running.folder).parts for p in running.folder.rglob("*") if p.is_file()]
    assert {parts[0] for parts in kept} == {"logs"}
    assert not any(p.name.startswith(".") for p in running.folder.rglob("*"))
    assert [p.name for p in running.folder.parent.iterdir()] == [running.folder.name]
